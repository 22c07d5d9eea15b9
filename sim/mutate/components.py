"""The components that are mutated, each with the tests that must find its mutants."""

from collections.abc import Mapping
from dataclasses import dataclass, field

TESTS = "tests/gateware"


@dataclass(frozen=True)
class Component:
    """A file of `gateware/` and its own tests.

    tests : files or cases below tests/gateware, in the order in which they run, of those in `make test`
    designs : of how many of the designs that the tests bring up mutants are drawn
    datapath : whether pixels or forces pass through it; then 95% of its mutants must be found
    survivors : why a mutant that no test finds is allowed, by the end of its line, "file.py:line what"
    """

    name: str
    tests: tuple[str, ...]
    designs: int = 1
    datapath: bool = True
    survivors: Mapping[str, str] = field(default_factory=dict)

    @property
    def source(self) -> str:
        return f"gateware/{self.name}.py"

    @property
    def test_paths(self) -> tuple[str, ...]:
        return tuple(f"{TESTS}/{test}" for test in self.tests)


DEPTH = "poisson/test_depth.py::test_displacement_bit_exact_to_golden_model"
COMPONENTS = (
    Component("arithmetic/frame_sum", ("arithmetic/test_frame_sum.py",), designs=2),
    Component("arithmetic/packed_products", ("arithmetic/test_packed_products.py",)),
    Component("arithmetic/product", ("arithmetic/test_product.py",), designs=2),
    Component(
        "arithmetic/shift_add",
        (
            "test_mlp_mvm.py::test_baked_weights",
            "arithmetic/test_shift_add.py::test_registers_hold_without_enable",
        ),
    ),
    Component("bus/axi_lite", ("bus/test_axi_lite.py",), datapath=False),
    Component("bus/calibration_loader", ("bus/test_calibration_loader.py",), datapath=False),
    Component("bus/frame_timer", ("bus/test_frame_timer.py",), datapath=False),
    Component("bus/registers", ("bus/test_registers.py",), datapath=False, designs=2),
    Component("dst1_engine", ("test_dst1_engine.py",)),
    Component("force/patch_generator", ("force/test_patch_generator.py",)),
    Component("force/weighted_sum", ("force/test_weighted_sum.py",)),
    Component("fz_stream", ("test_fz_stream.py",)),
    Component("mlp_mvm", ("test_mlp_mvm.py",), designs=2),
    Component("network/background", ("network/test_background.py",), designs=2),
    Component("network/gradient_ratio", ("network/test_gradient_ratio.py",)),
    Component("network/pixel_network", ("network/test_pixel_network.py",), designs=2),
    Component("network/requantise", ("network/test_requantise.py",), designs=2),
    Component("poisson/depth", ("poisson/test_depth.py",), designs=3),
    Component("poisson/dst2d", ("poisson/test_dst2d.py",)),
    Component("poisson/eigenvalue_division", ("poisson/test_eigenvalue_division.py",)),
    Component("poisson/frame_reversal", ("poisson/test_recurrence.py::test_reversal",)),
    Component(
        "poisson/recurrence",
        ("poisson/test_recurrence.py::test_recurrence_bit_exact_to_golden_model",),
        designs=2,
    ),
    Component("poisson/source", ("poisson/test_source.py",), designs=3),
    Component("poisson/transposer", ("poisson/test_transposer.py",)),
    Component("poisson/tridiagonal", ("poisson/test_tridiagonal.py",)),
    Component("stream/fork", ("stream/test_fork.py",), designs=2),
    Component("stream/frame_guard", ("stream/test_frame_guard.py",)),
    Component("stream/frame_validity", ("stream/test_frame_validity.py",)),
    Component("stream/handshake", (DEPTH, "poisson/test_source.py"), designs=2),
    Component("stream/queues", ("stream/test_queues.py",), designs=2),
    Component("stream/raster_port", ("stream/test_raster_port.py",), designs=2),
    Component(
        "stream/tables", ("poisson/test_depth.py::test_loaded_rest", "poisson/test_source.py"), designs=2
    ),
)
