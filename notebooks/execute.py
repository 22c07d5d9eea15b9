"""Executes the notebooks of this folder, each in a Python process of its own.

    python notebooks/execute.py [NAME...] [-o build/notebooks] [--pictures FOLDER]

Executed copies go to the folder of -o. With --pictures, the figure of each notebook's cell that is tagged
"picture" is written to FOLDER/NAME.png. `make notebooks` does both; tests/notebooks uses the functions.
"""

import argparse
import base64
import os
import resource
import sys
import time
from pathlib import Path

import nbformat
from jupyter_client import AsyncKernelManager
from jupyter_client.kernelspec import KernelSpecManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

FOLDER = Path(__file__).resolve().parent
TIMEOUT_S = 600
"""For one cell; on a machine that others use, too."""
TAG = "picture"
INLINE = "module://matplotlib_inline.backend_inline"
"""Matplotlib's backend that shows figures in place, whatever MPLBACKEND says."""


def names() -> list[str]:
    """The notebooks of this folder, without their suffix."""
    return sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def execute(
    name: str, folder: Path, *, before: str = "", after: str = "", environment: dict[str, str] | None = None
) -> nbformat.NotebookNode:
    """The notebook `name`, executed in `folder` by this Python; the file of the notebook stays as it is.

    before, after : source of cells that are executed first and last, and are in the result too
    environment : variables beside those of this process
    Raises CellExecutionError, with the cell and the traceback, where a cell fails.
    """
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    first, last = ([nbformat.v4.new_code_cell(text)] if text else [] for text in (before, after))
    notebook.cells = [*first, *notebook.cells, *last]
    # Without folders to look into it finds the kernel of this environment, none that is installed elsewhere.
    own = KernelSpecManager(kernel_dirs=[])
    kernel = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=own, transport_encryption="auto")
    client = NotebookClient(
        notebook,
        km=kernel,
        timeout=TIMEOUT_S,
        resources={"metadata": {"path": str(folder)}},
    )
    variables = {**os.environ, "MPLBACKEND": INLINE, **(environment or {})}
    return client.execute(env=variables, cleanup_kc=True)


def picture(notebook: nbformat.NotebookNode) -> bytes:
    """The PNG of an executed notebook's figure: that of its one cell that is tagged for it."""
    [cell] = [cell for cell in notebook.cells if TAG in cell.metadata.get("tags", ())]
    [png] = [output.data["image/png"] for output in cell.outputs if "image/png" in output.get("data", {})]
    return base64.b64decode(png)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="notebooks; all, if none is named")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("build/notebooks"), help="for executed copies"
    )
    parser.add_argument("--pictures", type=Path, help="folder for the pictures")
    given = parser.parse_args(arguments)
    chosen = [Path(name).stem for name in given.names] or names()
    if unknown := [name for name in chosen if name not in names()]:
        parser.error(f"{unknown[0]}: there are {', '.join(names())}")
    given.output.mkdir(parents=True, exist_ok=True)
    for name in chosen:
        start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            notebook = execute(name, Path.cwd())
        except CellExecutionError as error:
            print(f"{name}: {error}", file=sys.stderr)
            return 1
        nbformat.write(notebook, given.output / f"{name}.ipynb")
        if given.pictures:
            given.pictures.mkdir(parents=True, exist_ok=True)
            (given.pictures / f"{name}.png").write_bytes(picture(notebook))
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        print(f"{name}: {time.monotonic() - start:.0f} s, {cpu_s:.0f} s of processor time")
    return 0


if __name__ == "__main__":
    sys.exit(main())
