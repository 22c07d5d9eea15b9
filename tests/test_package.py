"""What is installed: one importable name, and all data files."""

import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("models", "sensor", "gateware", "sim", "scenes")
"""Of the repository's root, linked into the package."""
DATA = (".j2", ".json", ".toml", ".vlt", ".h", ".v", ".tcl", ".html", ".css", ".js")


def tracked() -> list[str]:
    """The repository's files that a package is made from."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    roots = ("fastac", *FOLDERS, "README.md", "LICENSE", "pyproject.toml")
    return [name for name in listed.stdout.split("\0") if name.split("/")[0] in roots]


def run(*command, cwd: Path) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from a copy of the tracked files: setuptools leaves folders where it builds."""
    pytest.importorskip("setuptools", minversion="77")
    source = tmp_path_factory.mktemp("source")
    for name in tracked():
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_symlink():
            target.symlink_to((ROOT / name).readlink())
        else:
            target.write_bytes((ROOT / name).read_bytes())
    folder = tmp_path_factory.mktemp("wheel")
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder)
    run(sys.executable, "-m", "pip", "wheel", *options, ".", cwd=source)
    [found] = folder.glob("fastac-*.whl")
    return found


@pytest.mark.full
def test_a_wheel_holds_every_module_and_data_file_below_one_name(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {name.split("/")[0].split("-")[0] for name in names} == {"fastac"}
    installed = [name for name in tracked() if Path(name).suffix in (".py", *DATA) and "/" in name]
    expected = {name if name.startswith("fastac/") else f"fastac/{name}" for name in installed}
    assert {name for name in names if "dist-info" not in name} == expected
    assert {Path(name).suffix for name in expected} == {".py", *DATA}


@pytest.mark.full
def test_a_user_s_folder_of_the_same_name_stays_theirs(wheel, tmp_path):
    """An empty environment, and a script beside folders that are called as the repository's are."""
    run(sys.executable, "-m", "venv", "--without-pip", tmp_path / "env", cwd=tmp_path)
    python = tmp_path / "env" / "bin" / "python"
    run(
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--no-deps",
        "--no-index",
        wheel,
        cwd=tmp_path,
    )
    # What it depends on is taken from here; links of an editable installation are not followed.
    [site] = (tmp_path / "env").glob("lib/*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    user = tmp_path / "user"
    (user / "models").mkdir(parents=True)
    (user / "models" / "__init__.py").write_text('WHOSE = "the user\'s"\n')
    script = user / "script.py"
    script.write_text(
        "import importlib.util, models\n"
        "import fastac, fastac.models.integer.words as words\n"
        "from fastac.scenes.schema import load\n"
        'assert models.WHOSE == "the user\'s"\n'
        "assert words.signed_width(127) == 8\n"
        "for name in ('sim', 'sensor', 'gateware', 'scenes'):\n"
        "    assert importlib.util.find_spec(name) is None, name\n"
        "from pathlib import Path\n"
        "print(load(Path(fastac.__file__).parent / 'scenes' / 'fast.toml').name, fastac.__file__)\n"
    )
    name, place = run(python, script, cwd=user).split()
    assert name == "fast"
    assert Path(place).is_relative_to(tmp_path / "env")
    assert "Usage: fastac" in run(tmp_path / "env" / "bin" / "fastac", "--help", cwd=user)
