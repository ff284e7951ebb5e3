"""A volume in pieces that fit into memory: whole layers of bricks, each chunk of the file read once where it fits."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from isosample.errors import InputError
from isosample.volume.lazy import LazySamples, Window, chunks_of, lazily

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from isosample.volume.bricks import Brick
    from isosample.volume.grid import SampleArray, Volume
    from isosample.volume.lazy import Triple

HALO = 1  # samples around a brick that its gradients need
COPIES = 3  # windows in memory at once: one at work, the next, and what its new part was read into


class Layer(NamedTuple):
    """Bricks of one layer in z that are read together, and the span [z, y, x] of samples they need."""

    rows: tuple[int, ...]
    low: Triple
    high: Triple


class BrickWindow(NamedTuple):
    """Bricks, by their rows in the list they came from, and the volume that answers for their samples."""

    rows: tuple[int, ...]
    volume: Volume


def brick_windows(volume: Volume, bricks: Sequence[Brick], *, budget_bytes: int) -> Iterator[BrickWindow]:
    """Yield windows that hold all given bricks with one sample around them, each brick once.

    Parameters
    ----------
    volume : Volume
        Lazily sliced, memory-mapped, or an array, of which views are given.
    bricks : sequence of Brick
        Any of `bricks_of`; only what they need is read.
    budget_bytes : int
        All windows in memory together take at most so much, the one being worked on and the next one included.

    Yields
    ------
    window : BrickWindow
        Ordered by z inside columns. The next one is read meanwhile: drop a window when it is done with.

    Raises
    ------
    InputError
        If the budget is too small for a single layer of a single brick.

    Notes
    -----
    A column of windows slides along z: what the next layer shares with this one is kept, and what is new is read
    up to a border of the file's chunks, so that no chunk is read twice in a column. Columns are as wide as the
    budget allows.
    """
    source = lazily(volume.array)
    if not isinstance(source, LazySamples):
        yield from _views(volume, bricks)
        return
    columns = _columns(source, bricks, volume.name, budget_bytes)
    pool = ThreadPoolExecutor(max_workers=1)
    try:
        windows = _read_columns(source, columns)
        coming = pool.submit(next, windows, None)
        while (found := coming.result()) is not None:
            layer, held = found
            del found
            coming = pool.submit(next, windows, None)
            array = cast("SampleArray", Window(held, layer.low, source.shape))
            del held
            yield BrickWindow(layer.rows, replace(volume, array=array))
            del array
    finally:
        pool.shutdown(cancel_futures=True)


def samples_read(volume: Volume, bricks: Sequence[Brick], *, budget_bytes: int) -> int:
    """How many samples `brick_windows` reads, with all of the chunks of the file that it touches; 0 of an array.

    Raises as `brick_windows`.
    """
    source = lazily(volume.array)
    if not isinstance(source, LazySamples):
        return 0
    found = 0
    for layers in _columns(source, bricks, volume.name, budget_bytes):
        reached = 0
        for layer in layers:
            if layer.high[0] <= reached:
                continue
            start = (max(layer.low[0], reached), *layer.low[1:])
            reached = _chunk_border(source, layer.high[0])
            stop = (reached, *layer.high[1:])
            chunks = (
                -(-end // size) - first // size
                for first, end, size in zip(start, stop, source.chunks, strict=True)
            )
            found += math.prod(chunks) * math.prod(source.chunks)
    return found


def _views(volume: Volume, bricks: Sequence[Brick]) -> Iterator[BrickWindow]:
    """Yield the volume itself for every layer of bricks."""
    for rows in _by_layer(bricks, range(len(bricks))):
        yield BrickWindow(rows, volume)


def _columns(source: LazySamples, bricks: Sequence[Brick], name: str, budget_bytes: int) -> list[list[Layer]]:
    """Layers of the fewest columns that fit into the budget."""
    rows_of = range(len(bricks))
    split_y, split_x = 1, 1
    extent_x, extent_y = (max((brick.index[axis] for brick in bricks), default=0) + 1 for axis in range(2))
    while True:
        groups: dict[tuple[int, int], list[int]] = {}
        for row in rows_of:
            bx, by, _ = bricks[row].index
            groups.setdefault((by * split_y // extent_y, bx * split_x // extent_x), []).append(row)
        columns = [_layers(source, bricks, rows) for _, rows in sorted(groups.items())]
        needed = COPIES * max(
            (_window_bytes(source, layer) for layers in columns for layer in layers), default=0
        )
        if needed <= budget_bytes:
            return columns
        if split_y < extent_y:
            split_y = min(2 * split_y, extent_y)
        elif split_x < extent_x:
            split_x = min(2 * split_x, extent_x)
        else:
            raise InputError(
                f"a memory budget with {budget_bytes} bytes for samples is too small for {name}: one brick with the "
                f"chunks of the file around it takes {needed}. Give more with --memory."
            )


def _layers(source: LazySamples, bricks: Sequence[Brick], rows: Sequence[int]) -> list[Layer]:
    """Layers of one column, ascending; all as wide as the widest needs."""
    chosen = [bricks[row] for row in rows]
    start = [max(min(brick.start[axis] for brick in chosen) - HALO, 0) for axis in (0, 1)]
    stop = [max(brick.stop[axis] for brick in chosen) + HALO + 1 for axis in (0, 1)]
    layers = []
    for layer in _by_layer(bricks, rows):
        brick = bricks[layer[0]]
        low = (max(brick.start[2] - HALO, 0), start[1], start[0])
        high = (brick.stop[2] + HALO + 1, stop[1], stop[0])
        z, y, x = (min(end, count) for end, count in zip(high, source.shape, strict=True))
        layers.append(Layer(layer, low, (z, y, x)))
    return layers


def _by_layer(bricks: Sequence[Brick], rows: Sequence[int]) -> list[tuple[int, ...]]:
    """Rows grouped by the place of their bricks along z, ascending."""
    groups: dict[int, list[int]] = {}
    for row in rows:
        groups.setdefault(bricks[row].index[2], []).append(row)
    return [tuple(group) for _, group in sorted(groups.items())]


def _window_bytes(source: LazySamples, layer: Layer) -> int:
    """Bytes of a window that reaches to a border of chunks."""
    depth = layer.high[0] - layer.low[0] + chunks_of(source)[0] - 1
    wide, high = layer.high[2] - layer.low[2], layer.high[1] - layer.low[1]
    return min(depth, source.shape[0]) * high * wide * source.dtype.itemsize


def _chunk_border(source: LazySamples, stop: int) -> int:
    """The first border of chunks along z that is not before a place; the last sample is followed by one."""
    depth = source.chunks[0]
    return min(-(-stop // depth) * depth, source.shape[0])


def _read_columns(
    source: LazySamples, columns: Sequence[Sequence[Layer]]
) -> Iterator[tuple[Layer, SampleArray]]:
    """Yield every layer with its samples, whose z starts at the layer's."""
    for layers in columns:
        held: SampleArray | None = None
        first = 0  # sample along z where `held` begins
        for layer in layers:
            (z, y, x), (stop, y_stop, x_stop) = layer.low, layer.high
            held_stop = first + (0 if held is None else len(held))
            if held is None or z >= held_stop:
                held, held_stop = None, z
            else:
                held = held[z - first :]
            if held is None or stop > held_stop:
                up_to = _chunk_border(source, stop)
                fresh = source.read((slice(held_stop, up_to), slice(y, y_stop), slice(x, x_stop)))
                held = fresh if held is None or not len(held) else np.concatenate([held, fresh])
                del fresh
            first = z
            yield layer, held
