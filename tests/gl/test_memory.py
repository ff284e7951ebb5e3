"""What the driver has no room for is refused, with its size and what makes it smaller, and nothing stays behind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import moderngl
import numpy as np
import pytest

from isosample.errors import CapacityError
from isosample.gl.memory import with_room

if TYPE_CHECKING:
    from collections.abc import Iterator


def test_what_has_room_is_returned(gl: moderngl.Context) -> None:
    buffer = gl.buffer(data=np.zeros(4, np.uint32))
    assert with_room(gl, buffer, "four numbers", 16, "Take fewer.") is buffer
    assert len(buffer.read()) == 16
    buffer.release()


def test_what_has_no_room_is_released_and_named(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors: Iterator[str] = iter(["GL_OUT_OF_MEMORY"])
    monkeypatch.setattr(moderngl.Context, "error", property(lambda _: next(errors, "GL_NO_ERROR")))
    buffer = gl.buffer(reserve=16)
    with pytest.raises(
        CapacityError, match=r"has no room for four numbers, 16 bytes \(GL_OUT_OF_MEMORY\)\. Take fewer\."
    ):
        with_room(gl, buffer, "four numbers", 16, "Take fewer.")
    assert isinstance(buffer.mglo, moderngl.InvalidObject)


def test_a_buffer_beyond_all_memory_is_refused(gl: moderngl.Context) -> None:
    with pytest.raises(CapacityError, match="Take fewer"):
        with_room(gl, gl.buffer(reserve=1 << 46), "numbers", 1 << 46, "Take fewer.")
