# amaranth: UnusedElaboratable=no
"""hardware.json of a bundle without elaborating anything, and frames for it."""

import json
from pathlib import Path

import numpy as np

from fastac.driver.description import FILE, Description, parse
from fastac.driver.transports.simulation import VERILOG
from fastac.flow.hardware import NAME, describe
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.integer.bundle import Bundle


def content(bundle: Bundle) -> dict:
    """What hardware.json says of the bundle's hardware, but for the hash of its netlist."""
    return describe(TopZynq(bundle), rtlil="")


def described(bundle: Bundle) -> Description:
    return parse(json.dumps(content(bundle)))


def write_hardware(bundle: Bundle, folder: Path) -> None:
    """The Verilog and hardware.json, without the linter and the files of other tools."""
    folder.mkdir(parents=True)
    (folder / FILE).write_text(json.dumps(content(bundle)))
    (folder / VERILOG).write_text(to_verilog(TopZynq(bundle), name=NAME))


def frames_of(bundle: Bundle, count: int, seed: int = 1) -> np.ndarray:
    """Frames (count, H, W, C) uint8: the background with noise, more and more; the last one noise alone."""
    rng, background = np.random.default_rng(seed), bundle.pipeline.background
    spans = np.linspace(2, 30, count).astype(int)
    noise = [background + rng.integers(-s, s + 1, background.shape) for s in spans]
    noise[-1] = rng.integers(0, 256, background.shape)
    return np.clip(noise, 0, 255).astype(np.uint8)
