"""What a comparison loads at a time fits its budget of memory, and is freed whatever happens."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import pytest

from compare.small_comparison import CAMERAS, SIZE, STEPS, blob_scene, small_experiment
from isosample.compare import contenders, experiment
from isosample.compare.contenders import SAMPLE_BYTES, TRIANGLE_BYTES
from isosample.compare.experiment import run_experiment
from isosample.compare.frames import draw_once, time_frames
from isosample.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.compare.contenders import Contender
    from isosample.compare.frames import Timing
    from isosample.rendering.camera import Camera

pytestmark = pytest.mark.usefixtures("gl")


@dataclass(slots=True)
class Groups:
    """What was timed together, and what was loaded and freed."""

    sizes: list[int] = field(default_factory=list)
    held: list[int] = field(default_factory=list)  # bytes, of every contender that was timed
    loaded: int = 0
    most_loaded: int = 0


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> Groups:
    """Filled while a comparison runs."""
    seen = Groups()

    def counted(group: Sequence[Contender], *rest: Any) -> None:
        seen.sizes.append(len(group))
        seen.held += [one.bytes for one in group]
        time_frames(group, *rest)

    def loading(one: Contender, cameras: Sequence[Camera]) -> Timing:
        seen.loaded += 1
        seen.most_loaded = max(seen.loaded, seen.most_loaded)
        return draw_once(one, cameras)

    def freeing(kind: type[contenders.SurfaceContender | contenders.RayContender]) -> None:
        release = kind.release

        def counted_release(one: Any) -> None:
            seen.loaded -= one._renderer is not None if hasattr(one, "_renderer") else one._caster is not None
            release(one)

        monkeypatch.setattr(kind, "release", counted_release)

    monkeypatch.setattr(experiment, "time_frames", counted)
    monkeypatch.setattr(experiment, "draw_once", loading)
    monkeypatch.setattr(experiment, "warm_up", lambda *_: None)
    freeing(contenders.SurfaceContender)
    freeing(contenders.RayContender)
    return seen


def picture_bytes(entries: int) -> int:
    """Memory of so many entries' pictures and the references: four float32 per pixel."""
    return 16 * SIZE[0] * SIZE[1] * len(CAMERAS) * (entries + 1)


@pytest.mark.parametrize(("spare", "expected"), [(0, [3, 1]), (-1, [2, 2])])
def test_contenders_that_do_not_fit_together_are_measured_in_groups(
    groups: Groups, spare: int, expected: list[int]
) -> None:
    texture = SAMPLE_BYTES * blob_scene().volume.array.size
    methods = ("post-classified", "pre-integrated")
    asked = small_experiment(budget_bytes=picture_bytes(4) + 3 * texture + spare, methods=methods)
    found = run_experiment(asked).results.to_dict()
    assert (groups.sizes, groups.most_loaded, groups.loaded) == (expected, max(expected), 0)
    assert [entry["name"] for entry in found["entries"]] == [
        f"{method}-step-{step}" for method in methods for step in ("2", "1-2")
    ]


def test_fragments_count_as_they_are_and_before_that_as_they_may_be(groups: Groups) -> None:
    most = 1 << 20
    scene = blob_scene()
    scene = replace(scene, render=replace(scene.render, fragment_budget_bytes=most))
    asked = replace(small_experiment(methods=("data-centric",)), scene=scene)
    found = run_experiment(asked).results.to_dict()
    meshes = [TRIANGLE_BYTES * entry["summary"]["triangles_extracted"] for entry in found["entries"]]
    pools = [held - mesh for held, mesh in zip(groups.held, meshes, strict=True)]
    assert all(0 < pool <= most for pool in pools)
    assert pools[0] < most
    # the first has drawn when the second one comes, of which only the bound is known
    both = picture_bytes(2) + groups.held[0] + meshes[1] + most
    for spare, expected in ((0, [2]), (-1, [1, 1])):
        groups.sizes.clear()
        run_experiment(replace(asked, budget_bytes=both + spare))
        assert groups.sizes == expected


def test_what_is_loaded_is_freed_where_a_later_setting_fails(
    groups: Groups, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare = contenders.RayContender.prepare

    def fails(one: contenders.RayContender) -> None:
        if one.setting.value == STEPS[1]:
            raise InputError("no more")
        prepare(one)

    monkeypatch.setattr(contenders.RayContender, "prepare", fails)
    with pytest.raises(InputError, match="no more"):
        run_experiment(small_experiment(methods=("pre-integrated", "post-classified")))
    assert (groups.most_loaded, groups.loaded) == (2, 0)
