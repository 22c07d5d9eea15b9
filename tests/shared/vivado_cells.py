"""The cells of a block design: parameters, pins and interfaces of IPs, and those of a packaged core.

Those of IPs are as in their product guides: AXI DMA PG021, SmartConnect PG247, Processor System Reset PG164,
Zynq UltraScale+ MPSoC PG201, Processing System 7 PG082.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

SPIRIT = "{http://www.spiritconsortium.org/XMLSchema/SPIRIT/1685-2009}"
PARAMETERS = {
    "axi_dma": {
        *("c_include_sg", "c_sg_include_stscntrl_strm", "c_sg_length_width", "c_addr_width"),
        *("c_include_mm2s", "c_include_mm2s_dre", "c_m_axis_mm2s_tdata_width", "c_m_axi_mm2s_data_width"),
        *("c_mm2s_burst_size", "c_include_s2mm", "c_include_s2mm_dre", "c_m_axi_s2mm_data_width"),
        *("c_s2mm_burst_size", "c_micro_dma"),
    },
    "smartconnect": {"NUM_SI", "NUM_MI", "NUM_CLKS"},
    "xlconcat": {"NUM_PORTS"},
    "ilconcat": {"NUM_PORTS"},
    "proc_sys_reset": {"C_EXT_RST_WIDTH"},
    "zynq_ultra_ps_e": {
        *("PSU__FPGA_PL0_ENABLE", "PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ", "PSU__USE__FABRIC__RST"),
        *("PSU__USE__M_AXI_GP0", "PSU__USE__M_AXI_GP1", "PSU__USE__M_AXI_GP2", "PSU__USE__S_AXI_GP2"),
        *("PSU__MAXIGP0__DATA_WIDTH", "PSU__SAXIGP2__DATA_WIDTH", "PSU__USE__IRQ0"),
        "PSU__CRF_APB__DDR_CTRL__FREQMHZ",
    },
    "processing_system7": {
        *("PCW_EN_CLK0_PORT", "PCW_FPGA0_PERIPHERAL_FREQMHZ", "PCW_EN_RST0_PORT", "PCW_USE_M_AXI_GP0"),
        *("PCW_USE_S_AXI_HP0", "PCW_S_AXI_HP0_DATA_WIDTH", "PCW_USE_FABRIC_INTERRUPT", "PCW_IRQ_F2P_INTR"),
    },
}
DEFAULTS = {
    "zynq_ultra_ps_e": {"PSU__USE__M_AXI_GP0": "1", "PSU__USE__M_AXI_GP1": "1", "PSU__FPGA_PL0_ENABLE": "1"},
    "processing_system7": {"PCW_USE_M_AXI_GP0": "1", "PCW_EN_CLK0_PORT": "1", "PCW_EN_RST0_PORT": "1"},
    "axi_dma": {"c_include_sg": "1", "c_include_mm2s": "1", "c_include_s2mm": "1"},
    "smartconnect": {"NUM_SI": "1", "NUM_MI": "1"},
    "xlconcat": {"NUM_PORTS": "2"},
    "ilconcat": {"NUM_PORTS": "2"},
}


@dataclass
class Cell:
    """An instance; pins: kind of each ("clock", "reset high", "reset low", "in", "out"); interfaces: "master"
    or "slave" of each."""

    kind: str
    parameters: dict[str, str] = field(default_factory=dict)
    pins: dict[str, str] = field(default_factory=dict)
    interfaces: dict[str, str] = field(default_factory=dict)
    widths: dict[str, int] = field(default_factory=dict)

    def on(self, name: str) -> bool:
        return self.parameters.get(name, "0") == "1"

    def refresh(self) -> None:
        """Pins and interfaces as the parameters want them."""
        build = getattr(self, f"_{self.kind}", None)
        if build:
            self.pins, self.interfaces = build()

    def _smartconnect(self):
        slaves = {f"S{k:02d}_AXI": "slave" for k in range(int(self.parameters["NUM_SI"]))}
        masters = {f"M{k:02d}_AXI": "master" for k in range(int(self.parameters["NUM_MI"]))}
        return {"aclk": "clock", "aresetn": "reset low"}, slaves | masters

    def _proc_sys_reset(self):
        outputs = ("peripheral_reset", "peripheral_aresetn", "interconnect_aresetn", "mb_reset")
        return {"slowest_sync_clk": "clock", "ext_reset_in": "in", **dict.fromkeys(outputs, "out")}, {}

    def _xlconcat(self):
        return {f"In{k}": "in" for k in range(int(self.parameters["NUM_PORTS"]))} | {"dout": "out"}, {}

    _ilconcat = _xlconcat

    def _axi_dma(self):
        pins = {"s_axi_lite_aclk": "clock", "axi_resetn": "reset low"}
        interfaces = {"S_AXI_LITE": "slave"}
        if self.on("c_include_sg"):
            pins["m_axi_sg_aclk"] = "clock"
            interfaces["M_AXI_SG"] = "master"
        if self.on("c_include_mm2s"):
            pins |= {"m_axi_mm2s_aclk": "clock", "mm2s_introut": "out", "mm2s_prmry_reset_out_n": "out"}
            interfaces |= {"M_AXI_MM2S": "master", "M_AXIS_MM2S": "master"}
        if self.on("c_include_s2mm"):
            pins |= {"m_axi_s2mm_aclk": "clock", "s2mm_introut": "out", "s2mm_prmry_reset_out_n": "out"}
            interfaces |= {"M_AXI_S2MM": "master", "S_AXIS_S2MM": "slave"}
        return pins, interfaces

    def _zynq_ultra_ps_e(self):
        pins, interfaces = {"pl_resetn0": "out"}, {}
        if self.on("PSU__FPGA_PL0_ENABLE"):
            pins["pl_clk0"] = "out"
        for key, name in (("GP0", "HPM0_FPD"), ("GP1", "HPM1_FPD"), ("GP2", "HPM0_LPD")):
            if self.on(f"PSU__USE__M_AXI_{key}"):
                pins[f"maxi{name.lower()}_aclk"] = "clock"
                interfaces[f"M_AXI_{name}"] = "master"
        if self.on("PSU__USE__S_AXI_GP2"):
            pins["saxihp0_fpd_aclk"] = "clock"
            interfaces["S_AXI_HP0_FPD"] = "slave"
        if self.on("PSU__USE__IRQ0"):
            pins["pl_ps_irq0"] = "in"
        return pins, interfaces

    def _processing_system7(self):
        pins, interfaces = {}, {}
        for key, name in (("PCW_EN_CLK0_PORT", "FCLK_CLK0"), ("PCW_EN_RST0_PORT", "FCLK_RESET0_N")):
            pins |= {name: "out"} if self.on(key) else {}
        if self.on("PCW_USE_M_AXI_GP0"):
            pins["M_AXI_GP0_ACLK"], interfaces["M_AXI_GP0"] = "clock", "master"
        if self.on("PCW_USE_S_AXI_HP0"):
            pins["S_AXI_HP0_ACLK"], interfaces["S_AXI_HP0"] = "clock", "slave"
        if self.on("PCW_USE_FABRIC_INTERRUPT") and self.on("PCW_IRQ_F2P_INTR"):
            pins["IRQ_F2P"] = "in"
        return pins, interfaces


def packaged(path: Path) -> Cell:
    """The core as its component.xml describes it; widths: bits of each stream."""
    root = ET.parse(path).getroot()
    cell = Cell(root.findtext(f"{SPIRIT}name"))
    for bus in root.iter(f"{SPIRIT}busInterface"):
        name, kind = bus.findtext(f"{SPIRIT}name"), bus.find(f"{SPIRIT}busType").get(f"{SPIRIT}name")
        parameters = {
            each.findtext(f"{SPIRIT}name"): each.findtext(f"{SPIRIT}value")
            for each in bus.iter(f"{SPIRIT}parameter")
        }
        master = bus.find(f"{SPIRIT}master") is not None
        if kind == "clock":
            cell.pins[name] = "clock"
        elif kind == "reset":
            cell.pins[name] = "reset high" if parameters["POLARITY"] == "ACTIVE_HIGH" else "reset low"
        elif kind == "interrupt":
            cell.pins[name] = "out"
        else:
            cell.interfaces[name] = "master" if master else "slave"
            if kind == "axis":
                cell.widths[name] = 8 * int(parameters["TDATA_NUM_BYTES"])
    return cell
