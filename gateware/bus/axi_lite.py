"""AXI4-Lite slave in front of a bus of 32-bit registers (Arm IHI 0022)."""

from amaranth import Cat, Module, Signal, unsigned
from amaranth.lib import enum, wiring
from amaranth.lib.wiring import In, Out


class Response(enum.Enum, shape=unsigned(2)):
    """AXI response codes, `bresp` and `rresp`."""

    OKAY = 0
    SLVERR = 2  # the register exists but refuses the access
    DECERR = 3  # no register at this address


def axi_lite_signature(address_width: int) -> wiring.Signature:
    """AXI4-Lite with 32 data bits, seen from the master. The slave ignores `awprot` and `arprot`."""
    return wiring.Signature(
        {
            "awaddr": Out(unsigned(address_width)),
            "awprot": Out(3),
            "awvalid": Out(1),
            "awready": In(1),
            "wdata": Out(32),
            "wstrb": Out(4),
            "wvalid": Out(1),
            "wready": In(1),
            "bresp": In(Response),
            "bvalid": In(1),
            "bready": Out(1),
            "araddr": Out(unsigned(address_width)),
            "arprot": Out(3),
            "arvalid": Out(1),
            "arready": In(1),
            "rdata": In(32),
            "rresp": In(Response),
            "rvalid": In(1),
            "rready": Out(1),
        }
    )


def register_bus_signature(address_width: int) -> wiring.Signature:
    """Register bus, seen from AxiLiteSlave; one read and one write may happen in the same clock.

    read, write : high for the one clock of the access
    read_word, write_word : index of the register, its byte address / 4
    write_data, write_mask : 32 data bits, and a mask of the bits to write
    read_data, read_response, write_response : the registers' answers, in the same clock
    """
    word = unsigned(address_width - 2)
    return wiring.Signature(
        {
            "read": Out(1),
            "read_word": Out(word),
            "read_data": In(32),
            "read_response": In(Response),
            "write": Out(1),
            "write_word": Out(word),
            "write_data": Out(32),
            "write_mask": Out(32),
            "write_response": In(Response),
        }
    )


class AxiLiteSlave(wiring.Component):
    """Serve one AXI4-Lite read and one write at a time, independently of each other.

    Members
    -------
    axil : AXI4-Lite slave, byte addresses of `address_width` bits, of which the lowest two are ignored
    bus : the registers, see `register_bus_signature`

    Address and data of a write may come in either order, any time apart. Every access appears exactly once on
    the bus, before its response is valid, and gets the bus's response. All outputs of `axil` come from
    registers, so an access takes at least 2 clocks.
    """

    def __init__(self, address_width: int):
        if not 3 <= address_width <= 32:
            raise ValueError(f"address_width {address_width}: expected 3 to 32")
        self.address_width = address_width
        super().__init__(
            {
                "axil": In(axi_lite_signature(address_width)),
                "bus": Out(register_bus_signature(address_width)),
            }
        )

    def elaborate(self, platform):
        m = Module()
        axil, bus = self.axil, self.bus

        def hold(channel, *payload):
            """Register one request of a channel; returns (register is full, registered payload)."""
            held = Signal(name=f"{channel}_held")
            copies = [Signal.like(signal, reset_less=True, name_suffix="_held") for signal in payload]
            m.d.comb += getattr(axil, f"{channel}ready").eq(~held)
            with m.If(~held):
                m.d.sync += held.eq(getattr(axil, f"{channel}valid"))
                m.d.sync += [copy.eq(signal) for copy, signal in zip(copies, payload, strict=True)]
            return held, copies

        aw_held, (write_address,) = hold("aw", axil.awaddr)
        w_held, (write_data, write_strobe) = hold("w", axil.wdata, axil.wstrb)
        ar_held, (read_address,) = hold("ar", axil.araddr)

        m.d.comb += [
            bus.write.eq(aw_held & w_held & ~axil.bvalid),
            bus.write_word.eq(write_address[2:]),
            bus.write_data.eq(write_data),
            bus.write_mask.eq(Cat(bit.replicate(8) for bit in write_strobe)),
            bus.read.eq(ar_held & ~axil.rvalid),
            bus.read_word.eq(read_address[2:]),
        ]
        with m.If(bus.write):
            m.d.sync += [
                aw_held.eq(0),
                w_held.eq(0),
                axil.bvalid.eq(1),
                axil.bresp.eq(bus.write_response),
            ]
        with m.Elif(axil.bready):
            m.d.sync += axil.bvalid.eq(0)
        with m.If(bus.read):
            m.d.sync += [
                ar_held.eq(0),
                axil.rvalid.eq(1),
                axil.rdata.eq(bus.read_data),
                axil.rresp.eq(bus.read_response),
            ]
        with m.Elif(axil.rready):
            m.d.sync += axil.rvalid.eq(0)
        return m
