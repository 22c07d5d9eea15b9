"""The extra `onnx`, which only the export to ONNX and its benchmark need."""


def require_onnx() -> None:
    """Raise RuntimeError, in one line, unless onnx and onnxruntime are installed."""
    try:
        import onnx  # noqa: F401
        import onnxruntime  # noqa: F401
    except ImportError as error:
        raise RuntimeError(f"{error.name} is not installed: run pip install -e '.[onnx]'") from None
