"""Tasks on worker processes: a task that brings its worker down costs its own result only.

A process that dies breaks its pool and every task in it, and the pool does not say whose fault it was. So few tasks are
handed out at a time, those that were out are solved again, each in a process of its own, and the rest goes to a new
pool.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from femfit.core.processes import process_pool

Task = TypeVar("Task")
Result = dict[str, Any]
Solve = Callable[[Task], Result]
Done = Callable[[Task, Result], Iterable[Task]]
"""Takes a task and its result, and returns the tasks that follow from it; they are next."""

AGAIN = "again"
"""Mark of a result that the machine, not the task, is to blame for: the same command tries it again."""

DIED: Result = {"status": "failed: the worker process died (out of memory, or killed)", AGAIN: True}
SPARE = 1  # tasks handed out beyond the workers, so that none waits for its next one


def solve_in_processes(tasks: Sequence[Task], solve: Solve[Task], done: Done[Task], workers: int) -> None:
    """Solve tasks in processes of this machine.

    Parameters
    ----------
    done : callable
        Called here with each task and its result, as they come, and returns what follows; the result is :data:`DIED`
        where the task's own process died.
    """
    waiting = deque(tasks)
    while waiting:
        out: dict[Future[Result], Task] = {}
        pool = process_pool(workers)  # starts them as tasks come
        try:
            work_off(pool, waiting, out, solve, done, workers + SPARE)
        except BrokenProcessPool:
            for task in out.values():
                follow(waiting, done(task, _alone(task, solve)))
        finally:
            pool.shutdown(wait=False, kill_workers=True)  # nothing is left to do, or the user will not wait for it


def solve_here(tasks: Sequence[Task], solve: Solve[Task], done: Done[Task]) -> None:
    """Solve tasks in this process."""
    waiting = deque(tasks)
    while waiting:
        task = waiting.popleft()
        follow(waiting, done(task, solve(task)))


def follow(waiting: deque[Task], tasks: Iterable[Task]) -> None:
    """Put tasks before all that wait, in their order.

    Parameters
    ----------
    tasks : iterable
        What follows from a task that was just done: a worker may have its mesh at hand.
    """
    waiting.extendleft(reversed(list(tasks)))


def work_off(
    executor: Executor,
    waiting: deque[Task],
    out: dict[Future[Result], Task],
    solve: Solve[Task],
    done: Done[Task],
    limit: int,
    lost: tuple[type[BaseException], ...] = (),
) -> None:
    """Hand tasks out to an executor until all are done.

    Parameters
    ----------
    waiting : deque
        Tasks to do; taken from the left.
    out : dict
        Tasks handed out by their future; filled and emptied here, so that the caller sees them after an error.
    """
    try:
        while waiting or out:
            while waiting and len(out) < limit:
                out[executor.submit(solve, waiting[0])] = waiting[0]
                waiting.popleft()
            for future in wait(out, return_when=FIRST_COMPLETED).done:
                try:
                    result = future.result()
                except lost:
                    result = DIED
                follow(waiting, done(out.pop(future), result))
    except BaseException:
        for future in out:
            future.cancel()
        raise


def _alone(task: Task, solve: Solve[Task]) -> Result:
    pool = process_pool(1)
    try:
        return dict(pool.submit(solve, task).result())
    except BrokenProcessPool:
        return DIED
    finally:
        pool.shutdown(wait=False, kill_workers=True)
