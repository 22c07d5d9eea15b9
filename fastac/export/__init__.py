"""What leaves the project for other programs and people: single-file bundles with a card, and ONNX."""
