"""What Vivado would know of a block design that a script builds: enough to tell whether it is complete.

What a script asks for and the model does not have is an error, as it is in Vivado.
"""

from pathlib import Path

from tcl_runner import TclError
from vivado_cells import DEFAULTS, PARAMETERS, Cell, packaged
from vivado_manual import COMMANDS, parsed

DDR = {
    "ps_0/SAXIGP2/HP0_DDR_LOW": (0, 0x8000_0000),
    "ps_0/SAXIGP2/HP0_DDR_HIGH": (0x8_0000_0000, 0x8_0000_0000),
    "ps_0/S_AXI_HP0/HP0_DDR_LOWOCM": (0, 0x2000_0000),
}
"""Segments of the processing systems' memory: start, bytes."""
OTHER = ("ps_0/SAXIGP2/HP0_LPS_OCM", "ps_0/SAXIGP2/HP0_QSPI", "ps_0/SAXIGP2/HP0_PCIE_LOW")
BOARD_PARTS = {
    "xilinx.com:kv260_som:part0:1.3": "xck26-sfvc784-2LV-c",
    "xilinx.com:kv260_som:part0:1.4": "xck26-sfvc784-2LV-c",
    "xilinx.com:zcu104:part0:1.1": "xczu7ev-ffvc1156-2-e",
    "tul.com.tw:pynq-z2:part0:1.0": "xc7z020clg400-1",
    "xilinx.com:kr260_som:part0:1.1": "xck26-sfvc784-2LVI-i",
}


class Vivado:
    """Answers the commands of a script; a call that Vivado would refuse is a TclError.

    slack : of the routed design's worst path, ns, for "max" (setup) and "min" (hold)
    routed : whether every net could be routed
    status : what becomes of each run
    """

    def __init__(self, folder: Path, *, slack=None, routed=True, status=None, clock_mhz=150.0):
        self.folder, self.routed, self.clock_mhz = folder, routed, clock_mhz
        self.slack = {"max": 0.3, "min": 0.02} | (slack or {})
        self.status = {"synth_1": "synth_design Complete!", "impl_1": "route_design Complete!"} | (
            status or {}
        )
        self.calls: list[list[str]] = []
        self.cells: dict[str, Cell] = {}
        self.nets: dict[str, str] = {}
        self.links: list[tuple[str, str]] = []
        self.addresses: dict[tuple[str, str], tuple[int, int]] = {}
        self.properties: dict[tuple[str, str], str] = {}
        self.part = ""
        self.validated = False
        self.launched: list[tuple[str, str]] = []

    def names(self) -> list[str]:
        """The commands that exist: those of the manual, and `exec`, so that no other tool is run."""
        return [*COMMANDS, "exec"]

    def answer(self, words: list[str]) -> str:
        self.calls.append(words)
        if words[0] == "exec":
            return ""
        try:
            name, options, positional = parsed(words)
        except ValueError as error:
            raise TclError(str(error)) from None
        if name in ("get_bd_cells", "get_bd_pins", "get_bd_intf_pins", "get_bd_addr_spaces"):
            return self._known(name, positional[0], quiet="quiet" in options)
        do = getattr(self, f"_{name}", None)
        return (do(options, positional) if do else None) or ""

    def called(self, name: str) -> list[list[str]]:
        return [words for words in self.calls if words[0] == name]

    # Objects

    def _known(self, name: str, path: str, *, quiet: bool) -> str:
        instance, _, rest = path.strip("/").partition("/")
        cell = self.cells.get(instance)
        found = (
            cell
            and {
                "get_bd_cells": not rest,
                "get_bd_pins": rest in cell.pins,
                "get_bd_intf_pins": rest in cell.interfaces,
                "get_bd_addr_spaces": rest == "Data"
                or f"M_AXI_{rest.removeprefix('Data_')}" in cell.interfaces,
            }[name]
        )
        if not found and not quiet:
            raise TclError(f"{name}: no {path}")
        return path.strip("/") if found else ""

    def _create_project(self, options, positional):
        self.part = options["part"]
        if "in_memory" in options:
            return
        Path(positional[1]).mkdir(parents=True, exist_ok=True)
        self.properties["project", "DIRECTORY"] = positional[1]

    def _current_project(self, options, positional):
        return "project"

    def _current_fileset(self, options, positional):
        return "sources_1"

    def _get_files(self, options, positional):
        return positional[0]

    def _get_runs(self, options, positional):
        return positional[0]

    def _get_board_parts(self, options, positional):
        return " ".join(name for name in BOARD_PARTS if name.startswith(positional[0].removesuffix("*")))

    def _get_ipdefs(self, options, positional):
        return positional[0].replace("*", "2.1")

    def _get_property(self, options, positional):
        name, target = positional
        if target in BOARD_PARTS and name == "PART_NAME":
            return BOARD_PARTS[target]
        if target in self.status and name == "STATUS":
            return self.status[target]
        if target in self.status and name == "DIRECTORY":
            return str(self.folder / "project" / f"fastac.runs/{target}")
        if name == "SLACK":
            return str(self.slack[target])
        if name == "PERIOD":
            return str(1000 / self.clock_mhz)
        if name == "BOARD_PART" and target == "project":
            return self.properties.get((target, name), "")
        if (target, name) in self.properties:
            return self.properties[target, name]
        raise TclError(f"get_property: {target} has no {name}")

    def _set_property(self, options, positional):
        pairs, target = (
            (options["dict"].split(), positional[0]) if "dict" in options else (positional[:2], positional[2])
        )
        if not target:
            raise TclError("set_property: no objects")
        cell = self.cells.get(target)
        for name, value in zip(pairs[::2], pairs[1::2], strict=True):
            if cell is None:
                self.properties[target, name.upper()] = value
                continue
            parameter = name.removeprefix("CONFIG.")
            if parameter not in PARAMETERS[cell.kind]:
                raise TclError(f"set_property: {cell.kind} has no {name}")
            cell.parameters[parameter] = value
            cell.refresh()

    # Block design

    def _create_bd_cell(self, options, positional):
        vendor, library, name, *_ = options["vlnv"].split(":")
        if vendor == "fastac":
            (path,) = (self.folder / "ip").glob(f"{name}/component.xml")
            cell = packaged(path)
        elif name in PARAMETERS and library == ("inline_hdl" if options["type"] == "inline_hdl" else "ip"):
            cell = Cell(name, dict(DEFAULTS.get(name, {})))
            cell.refresh()
        else:
            raise TclError(f"create_bd_cell: the catalog has no {options['vlnv']}")
        self.cells[positional[0]] = cell
        return positional[0]

    def _connect_bd_net(self, options, positional):
        if not all(positional):
            raise TclError("connect_bd_net: no object")
        driver, *loads = positional
        if self._kind(driver) != "out":
            raise TclError(f"connect_bd_net: {driver} is no output")
        for load in loads:
            if load in self.nets:
                raise TclError(f"connect_bd_net: {load} is driven by {self.nets[load]} already")
            self.nets[load] = driver

    def _kind(self, pin: str) -> str:
        instance, _, name = pin.partition("/")
        return self.cells[instance].pins[name]

    def _connect_bd_intf_net(self, options, positional):
        sides = {}
        for pin in positional:
            instance, _, name = pin.partition("/")
            sides[self.cells[instance].interfaces[name]] = pin
            if any(pin in link for link in self.links):
                raise TclError(f"connect_bd_intf_net: {pin} is connected already")
        if len(sides) != 2:
            raise TclError(f"connect_bd_intf_net: {positional}: expected a master and a slave")
        self.links.append((sides["master"], sides["slave"]))

    def _get_bd_addr_segs(self, options, positional):
        known = [*DDR, *OTHER]
        for instance, cell in self.cells.items():
            if cell.kind == "axi_dma":
                known.append(f"{instance}/S_AXI_LITE/Reg")
            elif cell.kind not in PARAMETERS:
                known.append(f"{instance}/s_axil/Reg")
        wanted = positional[0]
        ports = (
            ("SAXIGP2",) if any(c.kind == "zynq_ultra_ps_e" for c in self.cells.values()) else ("S_AXI_HP0",)
        )
        known = [name for name in known if name.split("/")[1] in (*ports, "S_AXI_LITE", "s_axil")]
        found = [n for n in known if n == wanted or (wanted.endswith("*") and n.startswith(wanted[:-1]))]
        if not found and "quiet" not in options:
            raise TclError(f"get_bd_addr_segs: no {wanted}")
        return " ".join(found)

    def _assign_bd_address(self, options, positional):
        space, segment = options["target_address_space"], positional[0]
        offset, size = DDR.get(segment, (0, 0))
        if "range" in options:
            offset, size = int(options["offset"], 0), int(options["range"], 0)
        for (other, name), (start, length) in self.addresses.items():
            if other == space and start < offset + size and offset < start + length:
                raise TclError(f"assign_bd_address: {segment} overlaps {name}")
        if offset % size:
            raise TclError(f"assign_bd_address: {segment}: {offset:#x} is no multiple of {size:#x}")
        self.addresses[space, segment] = (offset, size)

    def _exclude_bd_addr_seg(self, options, positional):
        if positional[0] not in OTHER:
            raise TclError(f"exclude_bd_addr_seg: {positional[0]}")

    def _validate_bd_design(self, options, positional):
        """As validate_bd_design and the DMA's own rules: raises TclError with all that is wrong."""
        wrong = []
        joined = {pin for link in self.links for pin in link}
        for instance, cell in self.cells.items():
            for name, kind in cell.pins.items():
                driver = self.nets.get(f"{instance}/{name}")
                if kind == "out":
                    continue
                if driver is None:
                    wrong.append(f"{instance}/{name}: not connected")
                elif kind == "clock" and driver.split("/")[1] not in ("pl_clk0", "FCLK_CLK0"):
                    wrong.append(f"{instance}/{name}: its clock is {driver}")
                elif kind == "reset high" and not driver.endswith("/peripheral_reset"):
                    wrong.append(f"{instance}/{name}: active high, driven by {driver}")
                elif kind == "reset low" and not driver.endswith("aresetn"):
                    wrong.append(f"{instance}/{name}: active low, driven by {driver}")
            wrong += [
                f"{instance}/{name}: not connected"
                for name in cell.interfaces
                if f"{instance}/{name}" not in joined
            ]
            if cell.kind == "axi_dma":
                wrong += self._dma_rules(instance, cell)
        if wrong:
            raise TclError("; ".join(wrong))
        self.validated = True

    def _dma_rules(self, instance: str, dma: Cell) -> list[str]:
        wrong, values = [], {key: int(value) for key, value in dma.parameters.items()}
        if not 8 <= values["c_sg_length_width"] <= 26:
            wrong.append(f"{instance}: c_sg_length_width {values['c_sg_length_width']}")
        for stream, prefix, of_core in (("M_AXIS_MM2S", "mm2s", 1), ("S_AXIS_S2MM", "s2mm", 0)):
            if stream not in dma.interfaces:
                continue
            link = next((link for link in self.links if f"{instance}/{stream}" in link), None)
            if link is None:
                continue
            core, _, port = link[of_core].partition("/")
            bits = self.cells[core].widths[port]
            memory = values[f"c_m_axi_{prefix}_data_width"]
            if memory not in (32, 64, 128, 256, 512, 1024) or memory < bits:
                wrong.append(f"{instance}: {prefix}: {memory} bits for a stream of {bits}")
            if prefix == "mm2s" and values["c_m_axis_mm2s_tdata_width"] != bits:
                wrong.append(
                    f"{instance}: mm2s stream of {values['c_m_axis_mm2s_tdata_width']} bits to {bits}"
                )
            space = f"{instance}/Data_{prefix.upper()}"
            if not any(key[0] == space for key in self.addresses):
                wrong.append(f"{space}: no memory")
        return wrong

    # Files and runs

    def _make_wrapper(self, options, positional):
        hdl = self.folder / "project/fastac.gen/sources_1/bd/system/hdl"
        hdl.mkdir(parents=True, exist_ok=True)
        (hdl / "system_wrapper.v").write_text("module system_wrapper; endmodule\n")

    def _generate_target(self, options, positional):
        if not self.validated:
            raise TclError("generate_target: the block design is not validated")
        handoff = self.folder / "project/fastac.gen/sources_1/bd/system/hw_handoff"
        handoff.mkdir(parents=True, exist_ok=True)
        (handoff / "system.hwh").write_text("<EDKSYSTEM/>\n")

    def _launch_runs(self, options, positional):
        step = options.get("to_step", "")
        self.launched.append((positional[0], step))
        folder = self.folder / "project/fastac.runs" / positional[0]
        folder.mkdir(parents=True, exist_ok=True)
        if step == "write_bitstream":
            self.status[positional[0]] = "write_bitstream Complete!"
            names = ["system_wrapper.bit"]
            if self.properties.get((positional[0], "STEPS.WRITE_BITSTREAM.ARGS.BIN_FILE")) == "true":
                names.append("system_wrapper.bin")
            for name in names:
                (folder / name).write_bytes(b"\xaa\x99\x55\x66")

    def _get_cells(self, options, positional):
        return "system_i/fastac_0/inst"

    def _get_pins(self, options, positional):
        return "system_i/fastac_0/clk"

    def _get_clocks(self, options, positional):
        return "clk_pl_0"

    def _get_sites(self, options, positional):
        return "BUFGCE_X0Y10 BUFGCE_X0Y2" if "BUFGCE" in options["filter"] else ""

    def _get_ports(self, options, positional):
        return positional[0] if positional else "s_axis_tdata rst"

    def _get_timing_paths(self, options, positional):
        return options["delay_type"]

    def _report_route_status(self, options, positional):
        return str(int(self.routed)) if "boolean_check" in options else ""

    def _write_hw_platform(self, options, positional):
        Path(positional[0]).write_text("")
