"""Commands that write what Vivado needs, and read back what it reports."""

from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FOLDER,
    announce,
    build_folder,
    bundle_folder,
    folder_of,
    load_scene,
    output_option,
    progress_option,
    run_build,
    store_beside,
)
from fastac.gateware.target.boards import BOARDS, NO_BOARD
from fastac.report.tables import text_table
from fastac.synth.vivado_reports import ORIGIN


@click.command()
@click.argument("source", type=INPUT, metavar="SCENE|BUNDLE")
@click.option(
    "--data", type=INPUT, help="Dataset of a recorded sensor to train SCENE on, if its bundle is missing."
)
@click.option(
    "--streams",
    type=click.Choice(["packets", "video"]),
    default="packets",
    show_default=True,
    help="Form of the core's streams, whatever the scene says. packets: for stock DMAs, with a block design."
    " video: for parts that send and take lines, the IP alone.",
)
@click.option(
    "--board",
    type=click.Choice([*BOARDS, NO_BOARD]),
    help="Board whose files set the processing system. [default: the first with the scene's part]",
)
@click.option("--saif", type=INPUT, help="Activity of the core's nets, from `fastac sim --trace saif`.")
@output_option("Folder to write; an older one is replaced at the end.", OUTPUT_FOLDER, "BUNDLE/vivado")
@progress_option
def vivado(source, data, streams, board, saif, output, progress):
    """Write a folder from which Vivado makes a bitstream: IP, block design, constraints, scripts.

    A SCENE is trained first, unless its build folder holds the bundle. Then, on a machine with Vivado, run
    `vivado -mode batch -source build.tcl` in the folder; docs/board.md goes on from there. Stock DMAs take
    frames and images as packets only, so the core is built with hardware.streams = "packets" unless --streams
    says video. Vivado is not needed here, and nothing of this was ever run in it.

    \b
    Example: fastac vivado scenes/paper.toml
    """
    from fastac.flow import vivado as flow

    if source.suffix == ".toml":
        scene = load_scene(source, data)
        source = build_folder(scene, None)
        run_build(scene, source, data, progress, until="bundle")
    output = output or folder_of(source) / "vivado"
    scene, chosen, rewritten = flow.write(
        bundle_folder(source),
        output,
        store_beside(source),
        announce,
        streams=streams,
        board=board,
        saif=saif,
        progress=progress,
    )
    click.echo(f"{output}: {scene.hardware.part}, streams {streams}, board {chosen}")
    if rewritten:
        click.echo(
            f"The scene has other streams, so this form was not in its build: simulate it with"
            f" fastac run {source} --via sim --verilog {output}"
        )
    if streams == "packets":
        click.echo(f"Now: cd {output} && vivado -mode batch -source build.tcl")
    else:
        click.echo(f"Video streams, no block design: add {Path(output) / 'ip'} to Vivado's IP repositories")


@click.command("vivado-reports")
@click.argument("build", type=INPUT)
@click.argument("folder", type=INPUT, required=False)
@click.option(
    "--core",
    is_flag=True,
    help="The reports of core/build.tcl, the core out of context, not those of build.tcl.",
)
def vivado_reports(build, folder, core):
    """Read the reports that Vivado wrote in FOLDER back into the build folder BUILD: vivado.json.

    FOLDER is what `fastac vivado` wrote, after build.tcl has run in it. [default: BUILD/vivado]
    `fastac report BUILD` then shows utilisation, timing and power as "reported by Vivado".

    \b
    Example: fastac vivado-reports build/paper
    """
    from fastac.flow import vivado as flow

    path, rows = flow.read_reports(build, folder or build / "vivado", core=core)
    click.echo(text_table(["", ORIGIN], rows))
    click.echo(f"{path}")
