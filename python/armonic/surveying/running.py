"""`survey`: the modes of a robot in many postures, in threads or on a cluster, in memory or into a store."""

from __future__ import annotations

import math
import os
import pickle
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import SurveyError
from armonic.loads import WrenchAxes, load_of
from armonic.surveying.block import FURTHEST, Block, compute
from armonic.surveying.dataset import Layout
from armonic.surveying.systems import Field
from armonic.surveying.walk import block_shape, blocks, reflected, walk_of

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client
    from numpy.typing import ArrayLike, NDArray

    from armonic.robot import Robot

    Box: TypeAlias = tuple[slice, ...]
    Span: TypeAlias = tuple[int, int, Box]
    Complex: TypeAlias = NDArray[np.complex128]
    Submit: TypeAlias = Callable[[int, int, Complex | None], Callable[[], Block]]

POSTURES_PER_BLOCK = 16384
FEWEST_BLOCKS = 6
FEWEST_PER_BLOCK = 256
"""The dense solver at the start of a block costs as much as following through that many postures."""
CONNECTED_WITHIN = "10s"
"""How long to wait for a scheduler to answer."""
BYTES_PER_BLOCK = 32e6
"""Shapes of one block; blocks of robots with many modes are shorter, and a quarter of it where shapes are kept."""


def survey(
    robot: Robot,
    postures: Any,
    *,
    sweep: Mapping[str, ArrayLike] | None = None,
    wrench: ArrayLike | None = None,
    frame: str | None = None,
    wrench_axes: WrenchAxes = "world",
    shapes: bool = False,
    participation: bool = True,
    store: str | Path | None = None,
    threads: int | None = None,
    client: Client | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Modal parameters of a robot in many postures, every mode under one number from the first posture to the last.

    The map of Do, Vu, Liu 2022, section 3.2. Modes are sorted by natural frequency at the first posture and followed
    from there, each from the neighbouring posture; every set is checked to be complete, and where continuation fails or
    the system is not symmetric (a moment, feedback of the whole state) the dense solver takes over. Postures are
    equilibria: joint springs are unloaded in them, or the controller feeds gravity and wrench forward.

    Args:
        robot: the robot.
        postures: the name of a path or posture in the robot file, an array (P, n) or (P, joints) or list of postures, a
            `Grid` or a `Sample` (whose postures come in an order in which neighbours follow each other).
        sweep: by parameter path, values that the robot takes one after the other; several paths go along with each
            other. The map gets a leading dimension named by the first.
        wrench: force (N) over moment (N m) on the robot at the origin of `frame`, (6,).
        frame: where the wrench acts.
        wrench_axes: "world", or "frame" for a wrench that turns with its frame.
        shapes: keep mode shapes, scaled to uᴴMu = 1.
        participation: keep each coordinate's share of the elastic energy.
        store: a folder for a Zarr store. The map streams into it in bounded memory; called again after it was ended in
            any way, the survey goes on where it stopped.
        threads: how many; by default one per processor.
        client: a `distributed.Client`, or the address of a Dask scheduler, whose workers do the work.
        progress: called with the number of postures done and of all.

    Returns:
        An `xarray.Dataset` over the dimensions of the map and `mode`: `pole` and `partner` (rad/s), `natural_freq_hz`,
        `damped_freq_hz`, `damping_ratio`, `mac` with the posture before, `event` (1 crossing, 2 veering), `stability`,
        `method`, `residual`, and `shape` and `participation` if they are kept. From a store it is read as it is used.

    Raises:
        SurveyError: postures or sweep do not fit, the map does not fit into memory or on the disk, or the store holds
            another survey.
        PostureError: a posture, wrench or frame does not fit the robot.
        ModelError: a posture has no modes, or nothing can deflect.
        UpdateError: a swept path is no number of the robot file.
        RobotFileError: a swept value is impossible, such as a negative mass.
    """
    walk, load = walk_of(robot, postures, sweep), load_of(robot, wrench, frame, wrench_axes)
    field = Field(robot, walk, load)
    field.refuse()
    first = field.dense(0)
    poles = 2 * int(first.oscillatory.sum()) + int((~first.oscillatory).sum())
    layout = Layout(field, (poles + 1) // 2, shapes, participation)
    size = 16.0 * layout.modes * first.shapes.shape[0] * (4 if shapes else 1)
    most = max(16, int(min(POSTURES_PER_BLOCK, BYTES_PER_BLOCK / size)))
    block = block_shape(walk.shape, _even(walk.count, most))
    with _workers(field, layout, threads, client) as workers:
        if store is not None:
            return _into_store(layout, block, store, workers, progress)
        return _in_memory(layout, block, workers, progress)


def _in_memory(
    layout: Layout,
    block: tuple[int, ...],
    workers: Workers,
    progress: Callable[[int, int], None] | None,
) -> xr.Dataset:
    walk = layout.field.walk
    _refuse_without_memory(layout)
    values = layout.empty()
    flat = {name: array.reshape(walk.count, *array.shape[len(walk.shape) :]) for name, array in values.items()}

    def put(_: Box, made: Block) -> None:
        where = made.where
        for name, rows in layout.values(made).items():
            flat[name][where] = rows

    for stop in _put_in_order(blocks(walk.shape, block), workers, put, {}):
        if progress is not None:
            progress(stop, walk.count)
    return layout.dataset(values)


def _into_store(
    layout: Layout,
    block: tuple[int, ...],
    path: str | Path,
    workers: Workers,
    progress: Callable[[int, int], None] | None,
) -> xr.Dataset:
    from armonic.surveying.store import Store

    walk = layout.field.walk
    store = Store(path, layout, block)
    done = store.done
    if progress is not None:
        progress(done, walk.count)
    known = {}
    if 0 < done < walk.count:
        places = reflected(walk.shape, np.arange(max(0, done - FURTHEST), done))
        known = {int(place): store.poles(int(place)) for place in places}

    def put(box: Box, made: Block) -> None:
        store.write(box, made.places, layout.values(made))

    rest = (span for span in blocks(walk.shape, block) if span[1] > done)
    for stop in _put_in_order(rest, workers, put, known):
        store.count(stop)
        if progress is not None:
            progress(stop, walk.count)
    return store.dataset()


def _put_in_order(
    spans: Iterator[Span], workers: Workers, put: Callable[[Box, Block], None], known: dict[int, Complex]
) -> Iterator[int]:
    """Compute blocks and put them where they belong; the step up to which everything is there, time after time.

    Args:
        spans: the blocks.
        workers: who computes and puts.
        put: takes the part of the axes that a block fills, and the block, with its modes in the order of the survey.
        known: poles (m, 2) by place, at the last places that are there already.
    """
    under_way: deque[tuple[int, Callable[[], None]]] = deque()

    def finished() -> int:
        stop, wait = under_way.popleft()
        wait()
        return stop

    for (_, stop, box), made in _in_order(spans, workers.submit, workers.ahead, known.__getitem__):
        for place, poles in zip(made.places[-FURTHEST:], made.poles[-FURTHEST:], strict=True):
            known[int(place)] = poles
        while len(known) > FURTHEST:  # a block is followed from at most so many places before it
            del known[next(iter(known))]
        under_way.append((stop, workers.aside(partial(put, box, made))))
        if len(under_way) > workers.ahead:
            yield finished()
    while under_way:
        yield finished()


def _in_order(
    spans: Iterator[Span], submit: Submit, ahead: int, poles: Callable[[int], Complex]
) -> Iterator[tuple[Span, Block]]:
    """Blocks in the order of the walk with their modes in that of the survey, `ahead` of them under way at a time.

    `poles` gives those (m, 2) at a place of a block that came before.
    """
    under_way: deque[tuple[Span, Callable[[], Block]]] = deque()

    def named() -> tuple[Span, Block]:
        span, result = under_way.popleft()
        block = result()
        if block.start is None:
            return span, block
        known = poles(block.start)
        # Real poles may share slots in another way than here; such a block is made again from the slots of the survey.
        return span, block.named_after(known) or submit(span[0], span[1], known)()

    for span in spans:
        under_way.append((span, submit(span[0], span[1], None)))
        if len(under_way) > ahead:
            yield named()
    while under_way:
        yield named()


@dataclass(frozen=True)
class Workers:
    """Who computes blocks.

    Attributes:
        submit: has a block computed; what it returns waits for the block.
        aside: has a job done that nobody waits for yet; what it returns waits for its end.
        ahead: how many blocks should be under way.
    """

    submit: Submit
    aside: Callable[[Callable[[], None]], Callable[[], None]]
    ahead: int


def _at_once(job: Callable[[], None]) -> Callable[[], None]:
    job()
    return lambda: None


@contextmanager
def _workers(field: Field, layout: Layout, threads: int | None, client: Client | str | None) -> Iterator[Workers]:
    wanted = {"shapes": layout.shapes, "participation": layout.participation}
    if client is not None:
        with _cluster(field, wanted, client) as workers:
            yield workers
        return
    count = _threads(threads)
    if count == 1 or field.walk.count == 1:
        yield Workers(lambda start, stop, known: lambda: compute(field, start, stop, known, **wanted), _at_once, 0)
        return
    with ThreadPoolExecutor(count, thread_name_prefix="survey") as pool:
        try:
            yield Workers(
                lambda start, stop, known: pool.submit(compute, field, start, stop, known, **wanted).result,
                lambda job: pool.submit(job).result,
                count,
            )
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _even(count: int, most: int) -> int:
    """Postures of a block, at most so many; an even number of blocks, so that two threads end together.

    It does not depend on the number of threads, for the last digits of the result do depend on the blocks.
    """
    wanted = max(FEWEST_BLOCKS, 2 * math.ceil(count / (2 * most)))
    return min(most, max(FEWEST_PER_BLOCK, math.ceil(count / wanted)))


def _threads(threads: int | None) -> int:
    if threads is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not (isinstance(threads, int | np.integer) and not isinstance(threads, bool) and 1 <= threads <= 1024):
        raise SurveyError("threads", found=f"{threads!r:.60}", expected="a number from 1 to 1024")
    return int(threads)


@contextmanager
def _cluster(field: Field, wanted: dict[str, bool], client: Client | str) -> Iterator[Workers]:
    try:
        import distributed
    except ImportError:
        raise SurveyError(
            "client",
            found="no Dask",
            expected="the package distributed",
            hint="Install it: pip install 'armonic[dask]'.",
        ) from None

    class Connection(distributed.Client):
        def __init__(self, address: str) -> None:
            try:
                super().__init__(address, timeout=CONNECTED_WITHIN, set_as_default=False)  # type: ignore[no-untyped-call]
            except BaseException:
                # What is half made would be closed by the garbage collector, where it can wait for itself for ever.
                self.close()  # type: ignore[no-untyped-call]
                raise

    own = None
    if isinstance(client, str):
        try:
            client = own = Connection(client)
        except (OSError, ValueError) as error:
            found = f"no scheduler ({str(error).splitlines()[0] if str(error) else type(error).__name__:.80})"
            raise SurveyError(
                f"scheduler {client}", found=found, expected="the address of a running one, such as tcp://host:8786"
            ) from error
    elif not isinstance(client, distributed.Client):
        expected = "a distributed.Client or the address of a scheduler"
        raise SurveyError("client", found=f"{client!r:.60}", expected=expected)
    try:
        # A task, not scattered data: what a lost worker held is made again by another.
        there = client.submit(pickle.loads, pickle.dumps(field), pure=False)
        workers = max(1, sum(client.nthreads().values()))  # type: ignore[no-untyped-call]
        yield Workers(
            lambda start, stop, known: client.submit(compute, there, start, stop, known, **wanted, pure=False).result,
            _at_once,
            2 * workers,
        )
    finally:
        if own is not None:
            own.close()  # type: ignore[no-untyped-call]


def _refuse_without_memory(layout: Layout) -> None:
    needed = sum(math.prod(shape) * np.dtype(v.dtype).itemsize for v, _, shape in layout.variables())
    try:
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return
    if needed > free:
        raise SurveyError(
            "map",
            found=f"{layout.field.walk.count} postures, which need {needed / 1e9:.3g} GB",
            expected=f"at most the {free / 1e9:.3g} GB of memory that are free",
            hint="Give a store, into which the map streams, or a coarser grid.",
        )
