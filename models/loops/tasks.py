"""Tasks of one frame that the threads of a team share, for compiled (numba) loops: who does what, who waits.

A team's board holds, for each phase of its work, how many tasks there are, are taken and are done. Each
member waits until all of the phase before are done, and takes tasks until none is left:

    wait(board, FIRST)
    task = take(board, SECOND, member)
    while task < tasks(board, SECOND):
        ...
        done(board, SECOND)
        task = take(board, SECOND, member)

A member takes the tasks of its own share first, the same in each frame, for what it has written lies in its
own processor's cache; then what others have not begun. So nobody waits for a member: a team of one does
everything, and one that comes late finds nothing left to do. What was written before a `done` is seen after
the `wait`.
"""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from fastac.store.compiled_loops import compiled

LINE = 8
"""int64 in a cache line: what members wait for does not lie beside what they take."""
SPINS = 64
"""How often to look before the processor is offered to others: a few microseconds."""
LINGER = 300
"""How often to look for the next frame, each time offering the processor to others: some 0.1 ms."""
BELL = np.zeros((1, 1, LINE), np.int64)
"""How many frames have been begun, by all teams of the process."""


def new_board(members: int, *tasks: int) -> np.ndarray:
    """A board for a team with so many tasks in each phase, of which none is taken.

    A row for each phase: the numbers of tasks and of members, and the BELL when the frame was begun; how many
    are done; how many of each member's share are taken. Each has a cache line of its own.
    """
    board = np.zeros((len(tasks), 2 + members, LINE), np.int64)
    board[:, 0, 0], board[:, 0, 1] = tasks, members
    return board


@intrinsic
def _add_one(typing_context, board, phase, line):
    """Atomically add one to a count, and return what was there before."""

    def generate(context, builder, signature, values):
        place = _place(context, builder, signature, values)
        return builder.atomic_rmw("add", place, ir.IntType(64)(1), "seq_cst")

    return types.int64(board, phase, line), generate


@intrinsic
def _read(typing_context, board, phase, line):
    """A count as the last thread has left it."""

    def generate(context, builder, signature, values):
        return builder.load_atomic(_place(context, builder, signature, values), "acquire", 8)

    return types.int64(board, phase, line), generate


def _place(context, builder, signature, values):
    """The address of a line of a phase, of a board in row order."""
    kind = signature.args[0]
    board = make_array(kind)(context, builder, values[0])
    indices = [
        context.cast(builder, value, given, types.intp)
        for value, given in zip(values[1:], signature.args[1:], strict=True)
    ]
    indices.append(context.get_constant(types.intp, 0))
    return cgutils.get_item_pointer(context, builder, kind, board, indices, wraparound=False)


@intrinsic
def _offer_processor(typing_context):
    """sched_yield() of the C library."""

    def generate(context, builder, signature, values):
        kind = ir.FunctionType(ir.IntType(32), [])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])

    return types.int32(), generate


@compiled(inline="always")
def tasks(board, phase):
    """How many tasks a phase has."""
    return board[phase, 0, 0]


@compiled()
def take(board, phase, member):
    """The number of the next task for a member; that of all tasks when none is left."""
    count, members = board[phase, 0, 0], board[phase, 0, 1]
    for turn in range(members):
        share = (member + turn) % members
        task = share * count // members + _add_one(board, phase, 2 + share)
        if task < (share + 1) * count // members:
            return task
    return count


@compiled(inline="always")
def done(board, phase):
    """Tell that a task that this member took is done."""
    _add_one(board, phase, 1)


@compiled(inline="always")
def wait(board, phase):
    """Wait until all tasks of a phase are done."""
    looked = 0
    while _read(board, phase, 1) < board[phase, 0, 0]:
        looked += 1
        if looked > SPINS:
            _offer_processor()


@compiled()
def begin(board, member, bell):
    """Tell the other members that a frame is begun, for member 0; before anything else."""
    if member == 0:
        board[0, 0, 2] = _add_one(bell, 0, 0) + 1


@compiled()
def linger(board, member, bell):
    """Stay a moment, for members but 0, until the next frame is begun; after everything else.

    Who leaves now needs Python's lock, for which member 0 would have to wait, and must be woken for the next
    frame.
    """
    begun = board[0, 0, 2]
    if member and begun:
        looked = 0
        while looked < LINGER and _read(bell, 0, 0) == begun:
            _offer_processor()
            looked += 1
