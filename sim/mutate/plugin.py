"""pytest plugin: a component's tests, with mutants of their design in place of the design.

Loaded by `pytest -p fastac.sim.mutate.plugin`, before anything imports a simulator. Tests under Verilator
(`sim.runner.simulate`) run their bench in forks of one simulator (`sim.benches.mutants`). Tests under
Amaranth's simulator are forked where they start it, and each child runs to the end of the test, so that
whatever the test checks afterwards counts. A mutant that one test finds is not tried in the next.
"""

import gc
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

import amaranth.sim
import pytest
from amaranth.hdl import Signal, Value
from amaranth.sim.pysim import PySimEngine

from fastac.gateware.target.elaboration import to_rtlil
from fastac.sim import runner
from fastac.sim.mutate.forks import FAILED, PASSED, Branch, Trial, in_fork, limit_s
from fastac.sim.mutate.imported import Netlist
from fastac.sim.mutate.netlist import SELECTOR, MutatedDesign, mutated
from fastac.store.files import content_hash, write_json

ROOT = Path(__file__).resolve().parents[2]
JOB = "FASTAC_MUTATE"
"""Environment variable with the file of the job; see `Job`."""


@dataclass(frozen=True)
class Job:
    """What one run of pytest is to do.

    files : sources of the component, below the root; only their cells are mutated
    designs : of how many of the tests' designs mutants are drawn, the first ones
    count : number of mutants of each
    folder : where netlists and `verdicts.json` go
    """

    files: tuple[str, ...]
    designs: int
    count: int
    seed: int
    folder: str


@dataclass
class Tried:
    """A design with its mutants' verdicts so far; a mutant without one has passed all tests."""

    design: MutatedDesign
    simulator: str
    tests: list[str] = field(default_factory=list)
    caught: dict[int, str] = field(default_factory=dict)

    def remaining(self) -> list[int]:
        return [m.number for m in self.design.mutants if m.number not in self.caught]

    def note(self, test: str, verdicts: dict[int, str]) -> None:
        self.tests.append(test)
        self.caught |= {k: f"{v}: {test}" for k, v in verdicts.items() if v != "passed"}


class Campaign:
    """The mutants of the designs that the tests of this process bring up."""

    def __init__(self, job: Job):
        self.job, self.folder = job, Path(job.folder).resolve()
        self.tried: dict[str, Tried] = {}
        self.test = ""
        self.branch: Branch | None = None

    def of(self, rtlil: str, name: str, simulator: str) -> Tried | None:
        """The design and its mutants; None if enough designs have been mutated already."""
        rtlil = rtlil.replace(f"{ROOT}/", "")
        key = content_hash(rtlil)[:16]
        if key not in self.tried:
            if sum(bool(tried.design.mutants) for tried in self.tried.values()) == self.job.designs:
                return None
            folder, job = self.folder / key, self.job
            design = mutated(rtlil, name, folder, count=job.count, seed=job.seed, files=job.files)
            self.tried[key] = Tried(design, simulator)
        return self.tried[key]

    def save(self) -> None:
        content = [
            {
                "name": tried.design.name,
                "folder": str(tried.design.folder),
                "simulator": tried.simulator,
                "tests": tried.tests,
                "mutants": [asdict(m) | {"what": m.what} for m in tried.design.mutants],
                "caught": tried.caught,
            }
            for tried in self.tried.values()
        ]
        write_json(self.folder / "verdicts.json", content)


def load_job() -> Job:
    content = json.loads(Path(os.environ[JOB]).read_text())
    return Job(**{**content, "files": tuple(content["files"])})


CAMPAIGN = Campaign(load_job())


def simulate(component, name, bench, folder, *, build_args=runner.QUICK, log_file=None, **settings) -> None:
    """As `sim.runner.simulate`, for each remaining mutant; raises if the unchanged design fails."""
    tried = CAMPAIGN.of(to_rtlil(component, name=name, sources=True), name, "Verilator")
    if tried is None or not tried.remaining():
        pytest.skip("no mutants of this design are left")
    folder = tried.design.folder / "simulation"
    folder.mkdir(exist_ok=True)
    mutants = folder / "mutants.json"
    mutants.write_text(json.dumps(tried.remaining()))
    built = runner.build(tried.design.folder / f"{name}.v", name, folder, build_args=build_args)
    extra = {"MUTANTS": str(mutants), "COCOTB_MAX_FAILURES": "1", "COCOTB_RANDOM_SEED": "1"}
    # The parent of the forks ends without results of its own, which cocotb takes for a failure.
    with suppress(RuntimeError, SystemExit):
        built.test(
            hdl_toplevel=name,
            test_module=f"fastac.sim.benches.mutants,{bench}",
            build_dir=folder,
            extra_env=settings | extra,
            log_file=folder / "bench.log",
        )
    verdicts = json.loads(mutants.read_text())
    assert isinstance(verdicts, dict), f"no verdicts: see {folder}"
    assert verdicts.pop("0") == "passed", f"the unchanged design fails: see {folder}"
    tried.note(CAMPAIGN.test, {int(k): v for k, v in verdicts.items()})


class TouchedSignals(PySimEngine):
    """Amaranth's engine, which notes the signals that testbenches read and set."""

    def __init__(self, design):
        super().__init__(design)
        self.touched = set()

    def get_value(self, expr):
        self.touched |= {id(signal) for signal in Value.cast(expr)._rhs_signals()}
        return super().get_value(expr)

    def set_value(self, expr, value):
        self.touched |= {id(signal) for signal in Value.cast(expr)._lhs_signals()}
        super().set_value(expr, value)


class MutatedSimulator:
    """As `amaranth.sim.Simulator`; `run` forks a child for each mutant, which runs to the test's end."""

    def __init__(self, toplevel):
        self._toplevel, self._calls = toplevel, []

    def add_clock(self, *arguments, **settings):
        self._calls.append(("add_clock", arguments, settings))

    def add_testbench(self, *arguments, **settings):
        self._calls.append(("add_testbench", arguments, settings))

    def add_process(self, *arguments, **settings):
        self._calls.append(("add_process", arguments, settings))

    def run(self) -> None:
        if CAMPAIGN.branch is None:
            self._try_mutants()
        else:
            self._simulator(self._toplevel).run()

    def _simulator(self, toplevel, engine="pysim", chosen=None):
        simulator = SIMULATOR(toplevel, engine=engine)
        if chosen is not None:
            simulator.add_testbench(chosen)
        for method, arguments, settings in self._calls:
            getattr(simulator, method)(*arguments, **settings)
        return simulator

    def _branch(self, cpu_limit_s=None) -> Trial | None:
        """Fork; the child gets None and goes on to the end of the test, the parent the child's trial."""
        branch = Branch(cpu_limit_s)
        if branch.is_child:
            CAMPAIGN.branch = branch
            return None
        return branch.trial()

    def _try_mutants(self) -> None:
        recorder = in_fork(self._record)
        assert recorder.verdict == "passed", recorder.message.decode()
        ids = json.loads(recorder.message)
        signals = {id(found): found for found in gc.get_objects() if isinstance(found, Signal)}
        # In an order of their own, so that tests of the same design agree on it.
        touched = sorted((signals[n] for n in ids if n in signals), key=lambda s: (s.name, s.src_loc))
        ports = {f"port_{k}": signal for k, signal in enumerate(touched)}
        rtlil = in_fork(lambda: to_rtlil(self._toplevel, ports=directed(ports), sources=True).encode())
        assert rtlil.verdict == "passed", rtlil.message.decode()
        tried = CAMPAIGN.of(rtlil.message.decode(), "top", "Amaranth")
        if tried is None or not tried.remaining():
            self._simulator(self._toplevel).run()
        else:
            self._try(tried, ports)

    def _record(self) -> bytes:
        simulator = self._simulator(self._toplevel, TouchedSignals)
        simulator.run()
        return json.dumps(sorted(simulator._engine.touched)).encode()

    def _try(self, tried: Tried, ports) -> None:
        module = json.loads((tried.design.folder / "mutated.json").read_text())["modules"]["top"]
        selector = Signal(tried.design.selector_bits)
        chosen = [0]

        async def choose(ctx):
            ctx.set(selector, chosen[0])

        # Built once for all forks; the parent runs it last, without a mutant.
        simulator = self._simulator(Netlist(module, ports | {SELECTOR: selector}), chosen=choose)
        limit, verdicts = None, {}
        for number in [0, *tried.remaining()]:
            trial = self._branch(limit)
            if trial is None:
                chosen[0] = number
                simulator.run()
                return
            if number == 0:
                assert trial.verdict == "passed", f"the netlist fails unmutated: {trial}"
                limit = limit_s(trial.cpu_s)
            else:
                verdicts[number] = trial.verdict
        tried.note(CAMPAIGN.test, verdicts)
        simulator.run()


def directed(ports):
    """Ports for Amaranth, which finds out itself which of them are inputs."""
    return {name: (signal, None) for name, signal in ports.items()}


SIMULATOR = amaranth.sim.Simulator
amaranth.sim.Simulator = MutatedSimulator
runner.simulate = simulate


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    CAMPAIGN.test = pyfuncitem.name
    try:
        result = yield
    except BaseException as error:
        if CAMPAIGN.branch is not None:
            CAMPAIGN.branch.end(FAILED, repr(error).encode()[:1000])
        raise
    if CAMPAIGN.branch is not None:
        CAMPAIGN.branch.end(PASSED)
    return result


def pytest_sessionfinish():
    CAMPAIGN.save()
