"""Commands that make hardware, simulate it and count what it needs."""

import json
import os

import click

from fastac.cli.common import (
    INPUT,
    SPLITS,
    build_folder,
    load_bundle,
    output_option,
    progress_option,
    run_build,
    store_option,
)
from fastac.report import synthesis_table
from fastac.scenes import schema as scenes
from fastac.sensor import samples as sensor_samples


@click.command()
@click.argument("bundle", type=INPUT)
@output_option("BUNDLE/verilog", "Folder to write; replaced when the new one is complete.")
@progress_option
def verilog(bundle, output, progress):
    """Verilog of BUNDLE for the XCZU19EG, linted, with Vivado's script and constraints."""
    from fastac.flow import hardware

    output = output or bundle / "verilog"
    hardware.write_verilog(load_bundle(bundle), output, progress=progress)
    file = output / f"{hardware.NAME}.v"
    click.echo(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--for", "hardware", type=INPUT, required=True, help="Bundle that the hardware was made from.")
@click.option(
    "--keep-force", type=INPUT, help="Keep the hardware's force; the bundle with it goes to this folder."
)
@click.option("-o", "--output", type=INPUT, required=True, help="The file to write.")
def calibration(bundle, hardware, with_hardware_force, output):
    """BUNDLE's pixel network, and what follows from it, as words for hardware that already runs.

    The hardware's register CALIBRATION takes them, 32 bits each, little-endian, one after another, while no
    frame is in flight. What a calibration does not bring must be the same in both bundles: formats, solver,
    weights of the force, which differ from training to training unless --keep-force takes the hardware's. The
    background is not part of it: let the hardware capture its own.
    """
    from fastac.gateware import calibration as images

    model, known = load_bundle(bundle), load_bundle(hardware)
    if with_hardware_force:
        model = images.with_hardware_force(model, known, with_hardware_force)
    words = images.calibration_words(model, known)
    output.parent.mkdir(parents=True, exist_ok=True)
    temporary = output.with_name(f".{output.name}.part")
    temporary.write_bytes(words.astype("<u4").tobytes())
    temporary.replace(output)
    click.echo(f"{output}: {len(words)} words, layout {words[0]:#010x}, sha256 {model.digest}")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset to take frames from.")
@click.option("--split", type=SPLITS, default="test", show_default=True)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    help="How many, spread over the split. [default: the scene's; with --trace 1]",
)
@click.option(
    "--verilog", "verilog_folder", type=INPUT, help="Folder of `fastac verilog`. [default: BUNDLE/verilog]"
)
@click.option(
    "--trace",
    type=click.Choice(["saif", "fst"]),
    help="Write the signals' activity for Vivado's report_power, or their waveforms, as fastac.saif or"
    " fastac.fst in the folder.",
)
@output_option("BUNDLE/sim", "Folder for the simulator, its logs and traces.")
@progress_option
def sim(bundle, data, split, frames, verilog_folder, trace, output, progress):
    """Send real frames through the simulated hardware and compare every value with the integer model.

    A trace holds the whole run: the reset, the check of the identity, the frames back to back, and what a
    driver reads after each; it ends when the last result was read. Of one frame that is the activity of a
    single measurement; with --frames 10 the frames overlap as in a steady stream. The clock is the scene's.
    A simulator that traces is slower, and is built in a folder of its own.
    """
    from fastac.flow import hardware
    from fastac.flow.frames import read
    from fastac.sim.check_top import trace_file

    model = load_bundle(bundle)
    samples = read(data, model.scene, progress=progress)
    count = frames or (1 if trace else model.scene.simulation.frames)
    index = sensor_samples.evenly_spaced(sensor_samples.split_indices(samples, split, data), count)
    output = output or bundle / "sim"
    found = hardware.simulate(
        model, samples, index, verilog_folder or bundle / "verilog", output, trace=trace, progress=progress
    )
    click.echo(json.dumps(found, indent=1))
    if trace:
        click.echo(trace_file(output, hardware.NAME, trace))
    if found["mismatches"]:
        raise click.ClickException(f"{found['mismatches']} mismatches; {found['first_mismatch']}")


@click.command()
@click.argument("source", type=INPUT, metavar="SCENE|BUNDLE")
@click.option("--data", type=INPUT, help="Recorded dataset to train SCENE on, if its bundle is missing.")
@output_option("BUNDLE", "Folder for synth.json and the cache, synth.")
@click.option(
    "--place-and-route/--no-place-and-route",
    default=True,
    help="Place every module on the 40 nm ECP5, or only count blocks.",
)
@click.option("--module", "modules", multiple=True, metavar="NAME", help="Only these, such as 'mlp.*'.")
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=min(2, os.cpu_count() or 1),
    show_default=True,
    help="Tools that run side by side, each on one core with up to 4 GB.",
)
@store_option("what the tools found")
@progress_option
def synth(source, data, output, place_and_route, modules, jobs, store, progress):
    """Count what hardware needs and find the clock that each of its modules reaches, without Vivado.

    Of a SCENE the model is trained first, unless its build folder has it.

    Yosys counts DSP48E2, block RAM, URAM, shift registers and look-up tables; nextpnr places and routes each
    module on a 40 nm ECP5, whose clock is a conservative bound for the XCZU19EG. Results are kept; only what
    has changed is done again. `fastac report` then takes the figures into the build's report, in place of
    estimates. Needs the extra `synth`: pip install -e '.[synth]'.
    """
    from fastac.gateware.target.device import DEVICE
    from fastac.synth import synthesis

    if source.suffix == ".toml":
        scene = scenes.load(source)
        source = build_folder(scene, None)
        run_build(scene, source, data, progress, until="bundle")
    output = output or source
    content = synthesis.synthesise(
        load_bundle(source),
        output,
        device=DEVICE,
        store=store,
        place_and_route=place_and_route,
        modules=modules,
        jobs=jobs,
        progress=progress,
    )
    click.echo(synthesis_table.table(content, DEVICE))
    click.echo(f"{output / synthesis.FILE}")
