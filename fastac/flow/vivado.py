"""From a bundle to the folder that Vivado runs, and back from Vivado's reports to the build's report."""

import shutil
from pathlib import Path

from pydantic import ValidationError

from fastac.flow import hardware, steps
from fastac.gateware.target.block_design import CORE
from fastac.gateware.target.boards import choose_board
from fastac.gateware.target.vivado_folder import write_vivado_folder
from fastac.models.integer import bundle as bundles
from fastac.scenes.schema import Scene, SceneError, describe
from fastac.store.files import DamagedFileError, read_json, write_folder_atomically
from fastac.store.steps import Step
from fastac.store.store import Announce, open_store
from fastac.synth import vivado_reports

NEEDED = ("scene", "part", "clock_mhz", "streams", "registers", "bundle_sha256")
"""Keys of hardware.json without which no folder can be written."""


def with_streams(scene: Scene, streams: str) -> Scene:
    """The scene with hardware.streams = `streams`; raises SceneError where it cannot have them."""
    content = scene.model_dump(mode="json")
    content["hardware"]["streams"] = streams
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        raise SceneError(
            f"scene {scene.name}: with hardware.streams = {streams!r}: {describe(error)}"
        ) from None


def verilog_of(
    bundle: Path, scene: Scene, store: Path, announce: Announce | None = None, *, progress: bool
) -> Path:
    """The folder with the Verilog of `bundle` for `scene`, elaborated if the step store has none.

    The scene may say other hardware than the bundle's own; the integers are those of the bundle.
    """
    step = Step(
        "verilog",
        steps.verilog,
        {"scene": scene, "bundle": bundle},
        (steps.VERILOG,),
        {"progress": progress},
    )
    return open_store(store).perform(step, announce).path(steps.VERILOG)


def write(
    bundle: Path,
    folder: Path,
    store: Path,
    announce: Announce | None = None,
    *,
    streams: str,
    board: str | None,
    saif: Path | None,
    progress: bool,
) -> tuple[Scene, str, bool]:
    """Write Vivado's folder for the bundle in the folder `bundle`; it appears whole or not at all.

    board : of gateware/target/boards.py; None: the first that has the scene's part
    saif : file of the simulated activity
    Returns the hardware's scene, the board, and whether the bundle's own scene has other streams.
    Raises SceneError, BoardError, BlockDesignError and HardwareError, in one line, for what cannot be.
    """
    model = bundles.load(bundle)
    scene = with_streams(model.scene, streams)
    board = choose_board(scene.hardware.part, board)
    verilog = bundle.parent / steps.VERILOG
    if not is_built(verilog, model.digest, streams):
        verilog = verilog_of(bundle, scene, store, announce, progress=progress)
    content = read_hardware(verilog)
    text = (verilog / f"{hardware.NAME}.v").read_text(encoding="utf-8")
    with write_folder_atomically(folder) as temporary:
        write_vivado_folder(text, content, temporary, board=board, saif=saif)
        shutil.copytree(verilog / "registers", temporary / "registers")
    return scene, board, model.scene.hardware.streams != streams


def is_built(folder: Path, digest: str, streams: str) -> bool:
    """Whether a build's folder has the Verilog of this very bundle with these streams."""
    try:
        content = read_hardware(folder)
    except (OSError, DamagedFileError):
        return False
    return (content["bundle_sha256"], content["streams"]) == (digest, streams)


def read_hardware(folder: Path) -> dict:
    """The content of hardware.json in a folder; raises DamagedFileError where a key in NEEDED is missing."""
    path = folder / "hardware.json"
    content = read_json(path)
    missing = [key for key in NEEDED if not isinstance(content, dict) or key not in content]
    if missing:
        raise DamagedFileError(f"{path}: {missing[0]}: missing")
    return content


def read_reports(build: Path, folder: Path, *, core: bool) -> tuple[Path, list[list[str]]]:
    """Read Vivado's reports in the folder that `write` wrote into vivado.json in the folder `build`.

    core : those of the core out of context, not those of the block design
    Returns the file and the rows of a table: name, figure. Raises ReportError where the reports are of
    another bundle or cannot be read.
    """
    content = read_hardware(folder)
    digest = bundles.load_bundle(build).digest
    if content["bundle_sha256"] != digest:
        raise vivado_reports.ReportError(
            f"{folder}: bundle_sha256 = {content['bundle_sha256'][:16]}…: that of {build} is {digest[:16]}…"
        )
    places = (folder / "core", None) if core else (folder / "output", CORE)
    found = vivado_reports.collect(places[0], content, instance=places[1])
    rows = [[name, f"{figure['value']:g}"] for name, figure in found["figures"].items()]
    return vivado_reports.write(found, build), rows
