"""What the work groups of the build pass by compute shaders take of the meshes."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.rendering import group_shares
from isosample.rendering.frame import storage_dtype
from isosample.rendering.group_shares import GroupShares, shares_of
from isosample.rendering.stage import LINE_GROUP, MOST_GROUPS, MOST_THREADS, renderer_threads

if TYPE_CHECKING:
    import moderngl

FIRST, COUNT, LEVEL = np.array([500, 0, 700]), np.array([64, 130, 1]), np.array([3, 5, 3])


def test_shares_are_all_items_of_the_runs_once_with_their_level() -> None:
    shares = shares_of(FIRST, COUNT, LEVEL)
    assert shares["count"].tolist() == [64, 64, 64, 2, 1]
    items = {(first + i, level) for first, count, level in shares.tolist() for i in range(count)}
    expected = {
        (first + i, level)
        for first, count, level in zip(FIRST, COUNT, LEVEL, strict=True)
        for i in range(count)
    }
    assert items == expected
    assert len(shares_of(FIRST[:0], COUNT[:0], LEVEL[:0])) == 0


@pytest.mark.parametrize(
    ("most_items", "most_groups", "calls"), [(10**6, 10**6, 1), (128, 10**6, 4), (10**6, 2, 3)]
)
def test_calls_read_what_they_may_and_take_all_shares(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, most_items: int, most_groups: int, calls: int
) -> None:
    """128 items at once: windows begin at multiples of 65, so that 0 and 64, 128, 500, and 700 are in one each."""
    monkeypatch.setattr(group_shares, "MOST_GROUPS", most_groups)
    shares = GroupShares(gl, "No remedy.")
    found = shares.fill(FIRST, COUNT, LEVEL, most_items)
    assert len(found) == calls
    assert shares._buffer is not None
    stored = np.frombuffer(shares._buffer.read(), dtype=storage_dtype("Share"))
    taken = []
    for call in found:
        assert call.groups <= most_groups
        first, count = call.window
        assert count <= most_items
        part = stored[call.first : call.first + call.groups]
        assert first <= part["first"].min()
        assert (part["first"] + part["count"]).max() <= first + count
        taken += part.tolist()
    assert sorted(taken) == sorted(shares_of(FIRST, COUNT, LEVEL).tolist())
    shares.release()


def test_shares_are_written_again_only_where_they_differ(gl: moderngl.Context) -> None:
    shares = GroupShares(gl, "No remedy.")
    found = shares.fill(FIRST, COUNT, LEVEL, 10**6)
    assert shares.fill(FIRST.copy(), COUNT, LEVEL, 10**6) is found
    assert shares.fill(FIRST, COUNT - 1, LEVEL, 10**6) is not found
    assert shares.fill(FIRST[:0], COUNT[:0], LEVEL[:0], 10**6) == []
    assert shares.size_bytes == 5 * storage_dtype("Share").itemsize
    shares.release()
    assert len(shares.fill(FIRST[:0], COUNT[:0], LEVEL[:0], LINE_GROUP)) == 0


def test_a_call_of_as_many_groups_as_there_may_be_is_one_that_opengl_allows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`run_interleaved` rounds groups up to a multiple of the threads; OpenGL allows 65535."""
    assert max(-(-MOST_GROUPS // threads) * threads for threads in range(1, MOST_THREADS + 1)) <= 65535
    for processors, expected in ((1, 1), (48, MOST_THREADS), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda found=processors: found)
        renderer_threads.cache_clear()
        assert renderer_threads() == expected
    renderer_threads.cache_clear()
