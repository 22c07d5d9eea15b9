"""The numbers: float models, training, quantisation, and the integer reference."""
