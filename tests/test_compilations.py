"""A first run says that kernels are compiled, where that takes long; runs that find their machine code do not."""

from __future__ import annotations

import logging
from functools import partial
from typing import TYPE_CHECKING

from numba import njit
from numba.core import event

from isosample import compiled
from isosample.cli import _log_as_notes

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


def test_long_compilations_are_told_once_nested_ones_counted_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    clock = Clock()
    monkeypatch.setattr(compiled, "time", clock)
    monkeypatch.setattr(compiled, "PATIENCE", 10.0)
    listener = compiled._Compilations()
    start, end = (
        partial(listener.notify, event.Event("numba:compile", status))  # type: ignore[no-untyped-call]
        for status in (event.EventStatus.START, event.EventStatus.END)
    )
    with caplog.at_level(logging.INFO, "isosample"):
        clock.now += 1000.0  # between compilations, other work
        for _ in range(2):  # 4 s each, of which 3 s in another one: 8 s in all
            start()
            clock.now += 1.0
            start()
            clock.now += 3.0
            end()
            end()
            clock.now += 50.0
        start()
        assert caplog.messages == []
        clock.now += 2.5
        start()  # after 10.5 s
        assert len(caplog.messages) == 1
        clock.now += 99.0
        start()
    (told,) = caplog.messages
    assert told.startswith("kernels are being compiled")


def test_a_kernel_without_machine_code_is_noticed_by_the_compiler_and_noted(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled, "PATIENCE", -1.0)

    double: Callable[[float], float] = njit(lambda number: 2.0 * number)
    with event.install_listener("numba:compile", compiled._Compilations()), _log_as_notes():
        assert double(4.0) == 8.0
        first = capfd.readouterr().err
        assert double(5.0) == 10.0
    assert first.startswith("isosample: note: kernels are being compiled")
    logging.getLogger("isosample").info("after the command")
    assert capfd.readouterr().err == ""
