import signal
import subprocess
import sys
import threading
import time
from multiprocessing import get_context
from pathlib import Path

import pytest
from toy_steps import states

from fastac.store.recording import unrecorded
from fastac.store.steps import Step


def test_a_pool_of_threads_is_recorded(toy):
    toy.write(
        "pooled.py",
        """
        from concurrent.futures import ThreadPoolExecutor
        from ROOT.solvers import SOLVERS

        def pooled(folder, scene):
            with ThreadPoolExecutor(2) as pool:
                bits = pool.submit(lambda: scene.numbers.slope_bits).result()
                return bits + pool.submit(lambda: SOLVERS[scene.solver]().solve()).result()
        """,
    )

    def step(**changes):
        return Step("pooled", toy.module("pooled").pooled, {"scene": toy.scene(**changes)})

    assert toy.store().value(step()) == 17
    assert toy.store().why(step(numbers={"fraction_bits": 15})) == "scene numbers.slope_bits = 17 was 16"
    toy.edit("solvers.py", "return 2", "return 3")
    assert toy.store().is_current(step())
    toy.edit("solvers.py", "return 1", "return 4")
    assert toy.store().why(step()) == f"code {toy.name}.solvers.Fast changed"


ROOT = Path(__file__).parents[3]
SLOW = """
    import time
    from pathlib import Path

    def slow(folder, log):
        with open(log, "a") as file:
            file.write("x")
        for name in ("a", "b"):
            (folder / name).mkdir()
            (folder / name / "part").write_text("1")
            time.sleep(SECONDS)
    """


PERFORM = """
import sys, time
sys.path[:0] = [{root!r}, {toys!r}]
from pathlib import Path
from fastac.store.closure import Code
from fastac.store.steps import Step
from fastac.store.store import Store
from {name}.slow import slow
store = Store(Path({kept!r}), Code({{{name!r}: Path({folder!r})}}))
step = Step("slow", slow, {{"log": {log!r}}}, ("a", "b"))
store.perform(step, lambda name, state: print(state, flush=True))
print("done", flush=True)
"""


def script(toy) -> list[str]:
    names = {"root": str(ROOT), "toys": str(toy.folder.parent), "name": toy.name, "kept": str(toy.kept)}
    text = PERFORM.format(**names, folder=str(toy.folder), log=str(toy.folder / "log"))
    return [sys.executable, "-c", text]


def test_two_processes_do_it_once(toy):
    toy.write("slow.py", SLOW.replace("SECONDS", "0.4"))
    first = subprocess.Popen(script(toy), stdout=subprocess.PIPE, text=True)
    second = subprocess.Popen(script(toy), stdout=subprocess.PIPE, text=True)
    said = sorted(process.communicate(timeout=60)[0].split() for process in (first, second))
    assert (toy.folder / "log").read_text() == "x"
    assert ["running", "done"] in said
    # A process that starts too late to wait finds the result.
    assert ["waiting", "kept", "done"] in said or ["kept", "done"] in said


def _perform_from_fork(toy, barrier, said):
    barrier.wait()
    step = Step("slow", toy.module("slow").slow, {"log": str(toy.folder / "log")}, ("a", "b"))
    states = []
    toy.store().perform(step, lambda name, state: states.append(state))
    said.put(states)


def test_the_second_process_waits(toy):
    toy.write("slow.py", SLOW.replace("SECONDS", "0.3"))
    context = get_context("fork")
    barrier, said = context.Barrier(2), context.Queue()
    workers = [context.Process(target=_perform_from_fork, args=(toy, barrier, said)) for _ in range(2)]
    for worker in workers:
        worker.start()
    states = sorted(said.get(timeout=60) for _ in workers)
    for worker in workers:
        worker.join()
    assert states == [["running"], ["waiting", "kept"]]
    assert (toy.folder / "log").read_text() == "x"


@pytest.mark.parametrize("moment", ["begun", "first output", "second output"])
def test_a_kill_leaves_nothing_half_done(toy, moment):
    toy.write("slow.py", SLOW.replace("SECONDS", "60" if moment != "second output" else "0.1"))
    if moment == "second output":
        toy.edit("slow.py", "time.sleep(0.1)", "time.sleep(60 if name == 'b' else 0.1)")
    process = subprocess.Popen(script(toy), stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "running\n"
    wanted = {"begun": "log", "first output": "a/part", "second output": "b/part"}[moment]
    give_up = time.time() + 30
    while not list(toy.folder.parent.rglob(wanted)) and time.time() < give_up:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not list((toy.kept / "slow").glob("*"))
    toy.write("slow.py", SLOW.replace("SECONDS", "0"))
    step = Step("slow", toy.module("slow").slow, {"log": str(toy.folder / "log")}, ("a", "b"))
    entry = toy.store().perform(step)
    assert (entry.path("b") / "part").read_text() == "1"
    assert not list((toy.kept / ".part").iterdir())


KILL = """
import os, signal
replace = os.replace
def killed(old, new):
    named = os.path.basename(os.path.dirname(new)) == "slow"
    if named and {when!r} == "before":
        os.kill(os.getpid(), signal.SIGKILL)
    replace(old, new)
    if named:
        os.kill(os.getpid(), signal.SIGKILL)
os.replace = killed
"""


@pytest.mark.parametrize(("when", "state"), [("before", "running"), ("after", "kept")])
def test_a_kill_around_the_renaming(toy, when, state):
    toy.write("slow.py", SLOW.replace("SECONDS", "0"))
    *python, text = script(toy)
    process = subprocess.run([*python, KILL.format(when=when) + text], stdout=subprocess.PIPE, timeout=60)
    assert process.returncode == -signal.SIGKILL
    step = Step("slow", toy.module("slow").slow, {"log": str(toy.folder / "log")}, ("a", "b"))
    assert states(toy, step) == [("slow", state)]
    assert not list((toy.kept / ".part").iterdir())


def test_threads_that_perform_other_steps_record_for_themselves(toy):
    toy.write(
        "meeting.py",
        """
        from ROOT.solvers import SOLVERS

        def meet(folder, name, meeting):
            meeting.wait(20)
            value = SOLVERS[name]().solve()
            meeting.wait(20)
            return value
        """,
    )
    meeting = threading.Barrier(2)

    def step(name):
        return Step("meet", toy.module("meeting").meet, {"name": name}, (), {"meeting": meeting})

    def perform(name):
        with unrecorded():
            toy.store().perform(step(name))

    toy.module("meeting")
    threads = [threading.Thread(target=perform, args=(name,)) for name in ("fast", "exact")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    toy.edit("solvers.py", "return 2", "return 3")
    assert toy.store().is_current(step("fast"))
    assert not toy.store().is_current(step("exact"))
