"""AXI4-Lite onto a bus of 32-bit registers."""

from amaranth import Cat, Module, Signal, unsigned
from amaranth.lib import enum, wiring
from amaranth.lib.wiring import In, Out


class Response(enum.Enum, shape=unsigned(2)):
    OKAY = 0
    SLVERR = 2  # the register is there but cannot be written
    DECERR = 3  # no register at this address


def axi_lite_signature(address_width: int) -> wiring.Signature:
    """AXI4-Lite with 32 bits of data, seen from the master. `awprot` and `arprot` are not read."""
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
    """Registers as AxiLiteSlave sees them; one read and one write may happen in the same clock.

    read, write : high for the one clock in which the access happens
    read_word, write_word : which register: the byte address / 4
    write_data, write_mask : 32 bits, and which of them to write
    read_data, read_response, write_response : answers in that same clock
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
    """Serve AXI4-Lite reads and writes, independently of one another, one at a time each.

    Members
    -------
    axil : AXI4-Lite, byte addresses of `address_width` bits; the two lowest are ignored
    bus : the registers, see `register_bus_signature`

    Address and data of a write may come in either order and any time apart. Every access is answered, with
    what the bus answers; an access happens once, before its response is offered. Every output of `axil`
    comes from a register, so a read or a write takes at least 2 clocks.
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
            """Registers for one request of a channel; returns whether there is one, and its payload."""
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
