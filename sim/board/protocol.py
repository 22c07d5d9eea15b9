"""What host and simulated board say to each other over a Unix-domain socket; all integers little-endian.

A request is `REQUEST`: operation, argument, address; MEMORY_WRITE has `argument` bytes behind it. Each is
answered by `REPLY`: status, bytes behind the reply, value, and clocks since reset. The simulation's clock
runs only while a request is answered.

READ, WRITE : 32-bit register of the core or of a DMA at a physical address; WRITE's argument is the value
MEMORY_READ, MEMORY_WRITE : `argument` bytes of memory at a physical address
RUN : let at most `argument` clocks pass, until an interrupt line is high whose bit is set in `address`; the
    value has the lines as they are then, in the order of the block design's concat
With status REFUSED the bytes behind the reply are a text that says why.
"""

import struct

REQUEST = struct.Struct("<IIQ")
REPLY = struct.Struct("<IIQQ")
READ, WRITE, MEMORY_READ, MEMORY_WRITE, RUN = range(1, 6)
DONE, REFUSED = range(2)
MEMORY_ADDRESS = 0x1000_0000
MEMORY_BYTES = 1 << 24
MAX_CLOCKS = 1 << 31
CORE_LINE, MM2S_LINE, S2MM_LINE = 0, 1, 2
"""Interrupt lines: the core, axi_dma_0 MM2S, axi_dma_0 S2MM, axi_dma_1 S2MM and so on."""
