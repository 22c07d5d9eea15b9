"""Which source files a step depends on."""

import hashlib
from pathlib import Path

from fastac.store.files import digest_file

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("gateware/**/*.py", "models/**/*.py")
"""What the Verilog follows from, beside the bundle."""
TRAINING_SOURCES = ("models/**/*.py", "fastac/flow/training.py", "fastac/flow/frames.py", "sensor/samples.py")
HARDWARE_SOURCES = (*SOURCES, "gateware/**/*.vlt", "fastac/flow/hardware.py")


def digest_sources(patterns: tuple[str, ...]) -> str:
    """One hash of the project's own source files that match, such as "models/**/*.py"."""
    digest = hashlib.sha256()
    for pattern in patterns:
        paths = sorted(ROOT.glob(pattern))
        if not paths:
            raise ValueError(f"{pattern}: no source file matches")
        for path in paths:
            digest.update(f"{path.relative_to(ROOT)} {digest_file(path)}\n".encode())
    return digest.hexdigest()


def source_digest() -> str:
    """Hash of the sources that the hardware of a bundle follows from."""
    return digest_sources(SOURCES)
