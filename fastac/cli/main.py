"""The command line."""

import click

from fastac.cli.adapt import adapt
from fastac.cli.bench import bench
from fastac.cli.build import build, compare, report, reproduce
from fastac.cli.common import Group
from fastac.cli.data import data, protocol
from fastac.cli.demos import grasp, vibration
from fastac.cli.export import card, export
from fastac.cli.hardware import calibration, registers, sim, synth, verilog
from fastac.cli.live import live
from fastac.cli.log import log
from fastac.cli.models import evaluate, objects, predict, train
from fastac.cli.prove import prove
from fastac.cli.recordings import import_
from fastac.cli.run import run
from fastac.cli.stream import listen, serve
from fastac.cli.trade import chips, scope, sweep, trade
from fastac.cli.training_studies import study
from fastac.cli.tune import tune
from fastac.cli.verify import verify
from fastac.cli.vivado import vivado, vivado_reports


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="fastac")
def main():
    """Vision-based tactile fingertips as verified FPGA hardware.

    `fastac build SCENE` runs everything in order: dataset, training, Verilog, its simulation, report.

    A SCENE is a TOML file that describes a sensor, the outputs wanted and the hardware. A BUNDLE is the
    folder of a trained model, all its integers; a build folder that contains one will do, and so will a
    single file NAME.fastac. DATA is an HDF5 dataset, simulated or imported. Every command explains itself
    with --help.

    \b
    Example: fastac build scenes/paper.toml
    """


COMMANDS = (
    *(build, reproduce, report, compare, data, protocol, import_),
    *(train, adapt, evaluate, predict, objects, vibration, grasp),
    *(
        verilog,
        registers,
        calibration,
        sim,
        run,
        verify,
        synth,
        sweep,
        tune,
        trade,
        scope,
        chips,
        study,
        prove,
        bench,
    ),
    *(vivado, vivado_reports, serve, listen, live, log),
    *(export, card),
)
for command in COMMANDS:
    main.add_command(command)
