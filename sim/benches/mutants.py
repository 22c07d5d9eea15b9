"""cocotb test that goes before a component's own bench: each mutant in a fork of the simulator.

The fork comes before the first clock, so that every mutant starts from the same power-on state, and the
simulator, Python and the bench are loaded once. In a child this test chooses the mutant and ends, and
cocotb goes on with the component's bench. The parent ends when all children have.
"""

import json
import os
from pathlib import Path

import cocotb
import cocotb.simulator
from cocotb.triggers import Timer
from cocotb_tools.check_results import get_results

from fastac.sim.mutate.forks import FAILED, PASSED, Branch, limit_s


def leave_with_the_verdict(branch: Branch, results: Path) -> None:
    """End the child where cocotb, whose results are in the file, would stop the simulator.

    Verilator waits for its threads when it stops, and a fork does not have them.
    """

    def leave() -> None:
        _, failures = get_results(results)
        branch.end(FAILED if failures else PASSED)

    os.environ["COCOTB_RESULTS_FILE"] = str(results)
    cocotb.simulator.stop_simulator = leave


@cocotb.test()
async def choose_mutant(dut):
    path = Path(os.environ["MUTANTS"])
    results = path.with_suffix(".xml")
    verdicts: dict[int, str] = {}
    limit = None
    for mutant in [0, *json.loads(path.read_text())]:
        branch = Branch(limit)
        if branch.is_child:
            leave_with_the_verdict(branch, results)
            dut.mutant.value = mutant
            await Timer(1, "step")
            return
        trial = branch.trial()
        verdicts[mutant] = trial.verdict
        if mutant == 0:
            limit = limit_s(trial.cpu_s)
            if trial.verdict != "passed":
                break
    path.write_text(json.dumps(verdicts))
    os._exit(PASSED)
