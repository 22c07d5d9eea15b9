"""Commands that write hardware, simulate it, and count the resources that it needs."""

import json
import os

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FILE,
    OUTPUT_FOLDER,
    build_folder,
    folder_of,
    load_bundle,
    output_option,
    progress_option,
    run_build,
    split_option,
    store_option,
)
from fastac.scenes import schema as scenes
from fastac.sensor import samples as sensor_samples


@click.command()
@click.argument("bundle", type=INPUT)
@output_option("Folder to write; an older one is replaced at the end.", OUTPUT_FOLDER, "BUNDLE/verilog")
@progress_option
def verilog(bundle, output, progress):
    """Write and lint the Verilog of BUNDLE for its hardware.part, with a script and constraints for Vivado.

    \b
    Example: fastac verilog build/paper/bundle -o rtl
    """
    from fastac.flow import hardware

    output = output or folder_of(bundle) / "verilog"
    hardware.write_verilog(load_bundle(bundle), output, progress=progress)
    file = output / f"{hardware.NAME}.v"
    click.echo(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


@click.command()
@click.argument("bundle", type=INPUT)
@output_option("Folder to write the files to.", OUTPUT_FOLDER, "BUNDLE/registers")
def registers(bundle, output):
    """Write the registers of BUNDLE's hardware for other tools, with the record of a result and all scales.

    fastac_registers.h for C and C++; fastac.svd (CMSIS-SVD) for debuggers and Rust; fastac.rdl (SystemRDL
    2.0); fastac.dtso, a device-tree overlay for user-space I/O of core, DMAs and a
    buffer; registers.md, a page to read. `fastac verilog` writes them too, into its folder `registers`.

    \b
    Example: fastac registers build/paper -o registers
    """
    from fastac.flow.hardware import interface_of
    from fastac.gateware.target.register_files.write import FILES, write_register_files

    output = output or folder_of(bundle) / "registers"
    write_register_files(interface_of(load_bundle(bundle)), output)
    click.echo(f"{output}: {', '.join(FILES.values())}")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option(
    "--for", "hardware", type=INPUT, required=True, help="Bundle that the running hardware was made from."
)
@click.option(
    "--keep-force",
    "with_hardware_force",
    type=OUTPUT_FOLDER,
    help="Keep the force weights of the hardware; the bundle that has them is written to this folder.",
)
@output_option("The file to write.", OUTPUT_FILE)
def calibration(bundle, hardware, with_hardware_force, output):
    """Write BUNDLE's pixel network, its dots and what depends on them as words for running hardware.

    A driver writes the words, 32 bits each, little-endian, one after another into the hardware's register
    CALIBRATION while no frame is in flight. All else must be equal in both bundles: word formats, solver and
    the force weights, which differ from training to training unless --keep-force takes those of the hardware
    (each dot those of the hardware's dot nearest to it).
    The background is not included: let the hardware capture it anew.

    \b
    Example: fastac calibration build/new --for build/paper -o calibration.bin
    """
    from fastac.gateware import calibration as images
    from fastac.store.files import write_atomically

    model, known = load_bundle(bundle), load_bundle(hardware)
    if with_hardware_force:
        model = images.with_hardware_force(model, known, with_hardware_force)
    words = images.calibration_words(model, known)
    with write_atomically(output) as temporary:
        temporary.write_bytes(words.astype("<u4").tobytes())
    click.echo(f"{output}: {len(words)} words, layout {words[0]:#010x}, sha256 {model.digest}")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset whose frames are sent.")
@split_option("test")
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    help="Number of frames, spread over the split. [default: the scene's simulation.frames; 1 with --trace]",
)
@click.option(
    "--verilog", "verilog_folder", type=INPUT, help="Folder of `fastac verilog`. [default: BUNDLE/verilog]"
)
@click.option(
    "--trace",
    type=click.Choice(["saif", "fst"]),
    help="Also write the signals' activity for Vivado's report_power (fastac.saif) or their waveforms"
    " (fastac.fst).",
)
@output_option("Folder for the simulator, its logs and traces.", OUTPUT_FOLDER, "BUNDLE/sim")
@progress_option
def sim(bundle, data, split, frames, verilog_folder, trace, output, progress):
    """Send frames of a dataset through the simulated hardware; compare every value with the integer model.

    A trace holds the whole run: reset, check of the identity registers, the frames back to back, and the
    reads of a driver after each, at the scene's clock. One frame gives the activity of a single measurement;
    with --frames 10 the frames overlap as in a steady stream. The simulator with a trace is slower and is
    built in a folder of its own.

    \b
    Example: fastac sim build/paper --data build/paper/data.h5 --frames 2
    """
    from fastac.flow import hardware
    from fastac.flow.frames import read
    from fastac.sim.check_top import trace_file

    model = load_bundle(bundle)
    samples = read(data, model.scene, progress=progress)
    count = frames or (1 if trace else model.scene.simulation.frames)
    index = sensor_samples.evenly_spaced(sensor_samples.split_indices(samples, split, data), count)
    folder = folder_of(bundle)
    output = output or folder / "sim"
    found = hardware.simulate(
        model, samples, index, verilog_folder or folder / "verilog", output, trace=trace, progress=progress
    )
    click.echo(json.dumps(found, indent=1))
    if trace:
        click.echo(trace_file(output, hardware.NAME, trace))
    if found["mismatches"]:
        raise click.ClickException(f"{found['mismatches']} mismatches; {found['first_mismatch']}")


@click.command()
@click.argument("source", type=INPUT, metavar="SCENE|BUNDLE")
@click.option(
    "--data", type=INPUT, help="Dataset of a recorded sensor to train SCENE on, if its bundle is missing."
)
@output_option("Folder for synth.json and the kept results, synth.", OUTPUT_FOLDER, "BUNDLE")
@click.option(
    "--place-and-route/--no-place-and-route",
    default=True,
    help="Also place and route every module on the 40 nm ECP5, or only count blocks.",
)
@click.option(
    "--module",
    "modules",
    multiple=True,
    metavar="NAME",
    help="Only modules of this name or pattern, such as 'mlp.*'; repeatable.",
)
@click.option(
    "--placements",
    type=click.IntRange(1, 5),
    default=1,
    show_default=True,
    help="How often the slowest modules are placed, each time from another seed; the lowest clock counts.",
)
@click.option(
    "--again",
    type=click.IntRange(1),
    default=10,
    show_default=True,
    help="How many modules, the slowest, are placed more than once.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=min(2, os.cpu_count() or 1),
    show_default=True,
    help="Tools that run at the same time, each on one core with up to 4 GB.",
)
@store_option("what the tools found")
@progress_option
def synth(source, data, output, place_and_route, modules, placements, again, jobs, store, progress):
    """Count the FPGA resources of a design and find the clock of each of its modules, without Vivado.

    A SCENE is trained first, unless its build folder holds the bundle.

    Yosys counts DSP slices, block RAM, URAM, shift registers and look-up tables of the scene's part; nextpnr
    places and routes each module on a 40 nm ECP5, whose clock is a conservative bound for the XCZU19EG.
    Unchanged modules are not counted again. `fastac report` then shows these figures in place of estimates.
    Needs the extra `synth`: pip install -e '.[synth]'.

    \b
    Example: fastac synth scenes/paper.toml
    """
    from fastac.gateware.target.device import device_of
    from fastac.report import synthesis_table
    from fastac.synth import synthesis

    if source.suffix == ".toml":
        scene = scenes.load(source)
        source = build_folder(scene, None)
        run_build(scene, source, data, progress, until="bundle")
    output = output or folder_of(source)
    bundle = load_bundle(source)
    device = device_of(bundle.scene)
    content = synthesis.synthesise(
        bundle,
        output,
        device=device,
        store=store,
        place_and_route=place_and_route,
        modules=modules,
        placements=placements,
        again=again,
        jobs=jobs,
        progress=progress,
    )
    click.echo(synthesis_table.table(content, device))
    click.echo(f"{output / synthesis.FILE}")
