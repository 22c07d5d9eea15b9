"""The hardware, in Amaranth. It knows the bundle and the integer reference, never torch."""
