# amaranth: UnusedElaboratable=no
from pathlib import Path

import pytest

from fastac.gateware.datapath import Datapath
from fastac.gateware.target.device import DEVICES, DeviceError, on_part
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import assemble, bundle
from fastac.models.integer.assemble import with_loadable
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.scenes.parts import PARTS
from fastac.scenes.schema import load
from fastac.synth import fits
from fastac.synth.fits import area, check_products, check_scene, random_pipeline

ROOT = Path(__file__).parents[3]
SCENES = sorted(path.stem for path in (ROOT / "scenes").glob("*.toml"))
ZYNQ7020 = "xc7z020clg400-1"


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    """A network whose 10-bit activations are packed into DSP48E2 but not into DSP48E1."""
    numbers = {"weight_bits": 8, "activation_bits": 10, "last_weight_bits": 12, "gradient_fraction_bits": 8}
    wanted = scene(("normals", "depth", "force_z"), numbers=numbers, lanes=2)
    return random_bundle(tmp_path_factory.mktemp("fits") / "bundle", wanted, hidden=(4, 4)).pipeline


def test_an_area_is_of_the_scenes_part(pipeline):
    for name in PARTS:
        found = area(on_part(pipeline, name))
        assert found.device is DEVICES[name]
        assert found.multipliers == Datapath(on_part(pipeline, name)).multipliers
        shares = found.percent
        assert list(shares) == [found.device.dsp.name, "RAMB36", "LUT"]
        assert shares["RAMB36"] == 100 * sum(found.block_rams.values()) / DEVICES[name].ramb36
        assert shares["LUT"] == 100 * sum(found.luts.values()) / DEVICES[name].lut
    default, small = area(pipeline), area(on_part(pipeline, ZYNQ7020))
    assert small.multipliers["normals"] > default.multipliers["normals"]
    assert small.block_rams == default.block_rams


def test_the_integers_are_the_same_on_each_part(pipeline):
    """And so are the words that a calibration loads, but for how they lie in the registers."""
    images = frames(pipeline.background, (10, 40))
    expected, found = (Emulator(p).run(images) for p in (pipeline, on_part(pipeline, ZYNQ7020)))
    assert (found.normal_words == expected.normal_words).all()
    assert (found.force_raw == expected.force_raw).all()
    networks = [Datapath(on_part(pipeline, name)).loadable_registers["network"] for name in PARTS]
    assert networks[0] == networks[1] == networks[2] != networks[3]
    baked = with_loadable(pipeline, False)
    assert Datapath(baked).multipliers == Datapath(on_part(baked, ZYNQ7020)).multipliers


def test_what_the_scene_alone_says(make_scene):
    """DSP slices and the memory of kernels are known without words; other memories are not."""
    wide = {"height_px": 256, "width_px": 256, "geometry": "flat"}
    lanes = {"pixels_per_clock": 4, "weights": "baked"}
    check_products(make_scene(sensor=wide, hardware={"pixels_per_clock": 2, "weights": "baked"}))
    with pytest.raises(DeviceError, match=r"^2,1\d\d DSP48E2 "):
        check_products(make_scene(sensor=wide, hardware=lanes))
    with pytest.raises(
        DeviceError, match=r"^\d+ DSP48E1 .*: the xc7z020clg400-1 has 220; choose numbers.data_bits"
    ):
        check_products(make_scene(hardware={"part": ZYNQ7020, "pixels_per_clock": 2}))
    with pytest.raises(
        DeviceError, match=r"^[\d,.]+ RAMB36 \(force [\d,.]+\): the xck26-sfvc784-2LV-c has 144"
    ):
        check_products(make_scene(sensor=wide, hardware={"part": "xck26-sfvc784-2LV-c"}))


def test_what_random_weights_say(make_scene):
    collapsed, tridiagonal = {"kernel": "collapsed"}, {"solver": "tridiagonal"}
    large = {"height_px": 128, "width_px": 128, "geometry": "flat", "pitch_mm": 0.125}
    small = {"part": ZYNQ7020, "weights": "baked"}
    # 63 products of two transforms, of words of 26 bits twice as many in the second one.
    wanted = make_scene(sensor=large, force=collapsed, poisson=tridiagonal, hardware=small)
    check_scene(wanted)
    assert area(random_pipeline(wanted)).multipliers["depth"] == 63 + 2 * (63 + 2)
    found = area(random_pipeline(wanted))
    assert found.fits
    assert found.percent["LUT"] < 100
    # With two lanes they are too many.
    hardware = wanted.hardware.model_copy(update={"pixels_per_clock": 2})
    wide = wanted.model_copy(update={"hardware": hardware})
    with pytest.raises(DeviceError, match=r"^3\d\d DSP48E1 .*; choose numbers.data_bits of 24 or fewer"):
        check_scene(wide)
    no_solver = make_scene(
        outputs=["force_xyz"],
        sensor=large,
        poisson={"solver": "adjoint"},
        force={"clamp": False, "fit": "slopes"},
        numbers={"activation_bits": 10},
        hardware=small | {"pixels_per_clock": 4},
    )
    check_products(no_solver)
    with pytest.raises(DeviceError, match=r"look-up tables by estimate \(.*: the xc7z020clg400-1 has 53,200"):
        check_scene(no_solver)


def shown(name: str) -> list[str]:
    """A shipped scene's row in docs/scenes.md: of each part, the shares of DSP slices, block RAMs, LUTs."""
    pipeline = random_pipeline(load(ROOT / f"scenes/{name}.toml"))
    cells = []
    for part in PARTS:
        found = area(on_part(pipeline, part))
        text = ", ".join(f"{percent:.0f}" for percent in found.percent.values())
        cells.append(f"{text}%" if found.fits else f"no: {text}%")
    return cells


@pytest.mark.parametrize("name", SCENES)
def test_what_the_page_says_of_the_shipped_scenes(name):
    page = (ROOT / "docs/scenes.md").read_text()
    assert f"| `{name}` | {' | '.join(shown(name))} |\n" in page
    check_scene(load(ROOT / f"scenes/{name}.toml"))


def test_the_scene_for_the_kria_leaves_room_for_the_rest_of_a_block_design():
    kria = load(ROOT / "scenes/kria.toml")
    assert kria.hardware.part == "xck26-sfvc784-2LV-c"
    assert max(area(random_pipeline(kria)).percent.values()) < 75
    hardware = kria.hardware.model_copy(update={"part": ZYNQ7020, "weights": "baked"})
    baked = kria.model_copy(update={"hardware": hardware})
    found = area(random_pipeline(baked))
    assert found.fits
    assert (sum(found.multipliers.values()), sum(found.block_rams.values())) == (196, 81.5)
    short = baked.model_copy(update={"numbers": kria.numbers.model_copy(update={"data_bits": 24})})
    assert sum(area(random_pipeline(short)).multipliers.values()) == 131


def test_a_pipeline_is_the_same_whatever_was_made_before(make_scene, tmp_path):
    """Networks and solvers are kept for the next scene with the same words."""
    adjoint = {"outputs": ["force_z"], "poisson": {"solver": "adjoint"}}
    wanted = [
        make_scene(),
        make_scene(outputs=["depth"]),
        make_scene(**adjoint, force={"clamp": False, "fit": "slopes"}),
        make_scene(poisson={"mode": "difference"}),
        make_scene(numbers={"weight_bits": 6}),
    ]
    together = [random_pipeline(each) for each in wanted]
    for k, (each, found) in enumerate(zip(wanted, together, strict=True)):
        fits._random_network.cache_clear()
        assemble._fitted.cache_clear()
        alone = random_pipeline(each)
        digests = [bundle.save(tmp_path / f"{k}{n}", p, {}).digest for n, p in enumerate((found, alone))]
        assert digests[0] == digests[1]
