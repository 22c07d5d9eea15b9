"""The components that are mutated, each with the tests that must find its mutants."""

from dataclasses import dataclass

TESTS = "tests/gateware"


@dataclass(frozen=True)
class Allowed:
    """Mutants that no test can or should find: on lines of the source that hold `code`, and why.

    changes : beginnings of what is changed, as the table of survivors says it; empty: anything
    """

    code: str
    why: str
    changes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Component:
    """A file of `gateware/` and its own tests.

    tests : files or cases below tests/gateware, in the order in which they run, of those in `make test`
    designs : of how many of the designs that the tests bring up mutants are drawn, the first ones
    datapath : whether pixels or forces pass through it; then 95% of its mutants must be found
    allowed : explanations of mutants that survive
    """

    name: str
    tests: tuple[str, ...]
    designs: int = 1
    datapath: bool = True
    allowed: tuple[Allowed, ...] = ()

    @property
    def source(self) -> str:
        return f"gateware/{self.name}.py"

    @property
    def test_paths(self) -> tuple[str, ...]:
        return tuple(f"{TESTS}/{test}" for test in self.tests)


ANOTHER_ORDER = "goes through other states in as many steps, and they are not visible"
NO_FILLING = (
    "under back-pressure the pipeline does not close its gaps: nothing is lost, and no rate is stated"
)
READ_AGAIN = "reads in clocks whose word nobody uses; what is used is read again"

COMPONENTS = (
    Component(
        "arithmetic/frame_sum",
        ("arithmetic/test_frame_sum.py::test_sums_under_verilator",),
        allowed=(Allowed("beat.eq(Mux(last, 0, beat + 1))", ANOTHER_ORDER),),
    ),
    Component("arithmetic/packed_products", ("arithmetic/test_packed_products.py",)),
    Component("arithmetic/product", ("arithmetic/test_product.py",), designs=2),
    Component(
        "arithmetic/shift_add", ("test_mlp_mvm.py::test_baked_weights", "test_mlp_mvm.py::test_baked_signs")
    ),
    Component("bus/axi_lite", ("bus/test_axi_lite.py",), datapath=False),
    Component("bus/calibration_loader", ("bus/test_calibration_loader.py",), datapath=False),
    Component("bus/frame_timer", ("bus/test_frame_timer.py",), datapath=False),
    Component("bus/registers", ("bus/test_registers.py",), datapath=False, designs=2),
    Component(
        "dst1_engine",
        ("test_dst1_engine.py::test_bit_exact_to_golden_model",),
        allowed=(Allowed("beat.eq(Mux(last_beat, 0, beat + 1))", ANOTHER_ORDER),),
    ),
    Component(
        "force/patch_generator",
        ("force/test_patch_generator.py",),
        allowed=(
            Allowed(
                "write.en.eq(advance & stepped)", "the word that has been written is written again", ("Y[0]",)
            ),
            Allowed(
                "outside = [beat == b", "a column of the window that only lanes beyond the row's end see"
            ),
        ),
    ),
    Component(
        "force/weighted_sum",
        ("force/test_weighted_sum.py::test_force_of_every_frame",),
        allowed=(Allowed("advance.eq(products.ready | ~products.valid)", NO_FILLING),),
    ),
    Component("fz_stream", ("test_fz_stream.py::test_force_of_every_frame",)),
    Component("mlp_mvm", ("test_mlp_mvm.py",), designs=2),
    Component(
        "network/background",
        ("network/test_background.py::test_capture",),
        allowed=(
            Allowed(
                "capturing.eq(own & ~last)", "the next beat is the first of a frame, which looks at `capture`"
            ),
        ),
    ),
    Component("network/gradient_ratio", ("network/test_gradient_ratio.py",)),
    Component("network/pixel_network", ("network/test_pixel_network.py",), designs=2),
    Component("network/requantise", ("network/test_requantise.py",), designs=2),
    Component("poisson/depth", ("poisson/test_depth.py",), designs=3),
    Component("poisson/dst2d", ("poisson/test_dst2d.py::test_bit_exact_to_golden_model",)),
    Component("poisson/eigenvalue_division", ("poisson/test_eigenvalue_division.py",)),
    Component("poisson/frame_reversal", ("poisson/test_recurrence.py::test_reversal",)),
    Component("poisson/recurrence", ("poisson/test_recurrence.py",), designs=2),
    Component("poisson/source", ("poisson/test_source.py",), designs=3),
    Component("poisson/transposer", ("poisson/test_transposer.py",)),
    Component("poisson/tridiagonal", ("poisson/test_tridiagonal.py::test_bit_exact_to_golden_model",)),
    Component("stream/fork", ("stream/test_fork.py",), designs=2),
    Component("stream/frame_guard", ("stream/test_frame_guard.py",)),
    Component("stream/frame_validity", ("stream/test_frame_validity.py",)),
    Component("stream/handshake", ("stream/test_handshake.py",), designs=2),
    Component("stream/queues", ("stream/test_queues.py",), designs=2),
    Component("stream/raster_port", ("stream/test_raster_port.py",), designs=2),
    Component(
        "stream/tables", ("poisson/test_depth.py::test_loaded_rest", "poisson/test_source.py"), designs=2
    ),
)
