"""The hardware, in Amaranth. It imports the bundle and the integer golden model, never torch."""
