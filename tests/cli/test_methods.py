"""`render` refuses an option of another method, names both, and says what to do."""

from __future__ import annotations

import enum
import re
from inspect import signature
from itertools import product
from typing import TYPE_CHECKING

import pytest

from cli.harness import Run, content
from isosample.cli import build_parser, values
from isosample.cli.methods import (
    METHODS,
    RAYCAST_OPTIONS,
    SURFACE_OPTIONS,
    WRITTEN,
    option,
)
from isosample.cli.raycast import raycast_settings_of
from isosample.compare.sweep import Sweep
from isosample.defaults import CHOSEN_FROM, COMPARED_METHODS, RAYCAST_METHODS
from isosample.rendering.raycast_settings import Classification, RaycastSettings
from isosample.surfaces.settings import REFINEMENTS
from isosample.volume.filters import anisotropic_diffusion
from isosample.wording import fraction_text

if TYPE_CHECKING:
    from pathlib import Path

RENDER = "render blob.npy --tf tf.json --size 16x16 -o out.png"
SAMPLING = (
    "--step 1/4",
    "--sampling uniform",
    "--pixel-scale 2",
    "--adaptive",
    "--jitter 1",
    "--filtering hardware",
    "--no-skipping",
    "--macrocells 8",
)
OWNERS = {  # of every option of the ray caster, as written on a command line
    **dict.fromkeys(SAMPLING, RAYCAST_METHODS),
    "--transfer texture": ("post-classified", "peak-finding"),
    "--quadrature riemann": ("post-classified", "peak-finding"),
    "--integration 2d": ("pre-integrated",),
    "--table-size 64": ("pre-integrated",),
    "--table-dtype float16": ("pre-integrated",),
    "--peak-mode xor": ("peak-finding",),
    "--peak-weight integral": ("peak-finding",),
    "--crossings exact": ("peak-finding",),
    "--peak-bins 64": ("peak-finding",),
    "--peaks 4": ("peak-finding",),
    "--root-iterations 2": ("peak-finding",),
}
MESHES = {
    "--cache meshes",
    "--mesh-budget 1GiB",
    "--per-slope 3",
    "--max-isovalues 9",
    "--refine 2",
    "--details 2",
    "--screen-error 1",
    "--plan",
    "--segment linear",
    "--segment-opacity exponential",
    "--curved",
    "--strict",
    "--error-map map.png",
}
FOREIGN = [
    *((given, method) for given, owners in OWNERS.items() for method in METHODS if method not in owners),
    *product(sorted(MESHES), RAYCAST_METHODS),
]


def test_every_option_is_tried() -> None:
    assert {given.split()[0] for given in OWNERS} == {option(name) for name in RAYCAST_OPTIONS}
    assert {given.split()[0] for given in MESHES} == {option(name) for name in SURFACE_OPTIONS}
    assert set(WRITTEN) <= set(RAYCAST_OPTIONS)


def test_every_setting_of_the_ray_caster_has_an_option() -> None:
    assert {*RAYCAST_OPTIONS, "classification", "reconstruction"} == set(RaycastSettings.__slots__)


@pytest.mark.parametrize(("given", "method"), FOREIGN, ids=[f"{a} of {b}" for a, b in FOREIGN])
def test_an_option_of_another_method_is_refused(run: Run, folder: Path, given: str, method: str) -> None:
    before = content(folder)
    outcome = run(f"{RENDER} --method {method} {given}")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    owners = OWNERS.get(given, ("data-centric",))
    whose = "the ray caster" if owners == RAYCAST_METHODS else owners[0]
    for named in (given.split()[0], f" {method}", whose, "leave it out"):
        assert named in outcome.err
    assert content(folder) == before


@pytest.mark.parametrize(("given", "method"), [(given, owners[0]) for given, owners in OWNERS.items()])
def test_an_option_of_the_method_reaches_its_settings(given: str, method: str) -> None:
    companion = {
        "--pixel-scale 2": "--sampling differential",
        "--table-size 64": "--integration 3d",
        "--table-dtype float16": "--integration 2d",
    }.get(given, "")
    parser = build_parser()
    plain, changed = (
        raycast_settings_of(parser.parse_args(f"{RENDER} --method {method} {options}".split()), method)
        for options in (companion, f"{companion} {given}")
    )
    if given != "--sampling uniform":  # the default, spelled out
        assert plain != changed
    assert plain.classification is changed.classification
    assert changed.classification.value == method


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (
            "pre-integrated --sampling differential --step 1/2",
            ("--step", "--sampling uniform", "differential"),
        ),
        ("pre-integrated --pixel-scale 2", ("--pixel-scale", "--sampling differential", "uniform")),
        ("pre-integrated --table-size 64", ("--table-size", "--integration 2d or 3d", "exact")),
        (
            "pre-integrated --integration 1d --table-dtype float16",
            ("--table-dtype", "--integration 2d or 3d", "1d"),
        ),
        ("peak-finding --crossings exact --peaks 4", ("--peaks", "--crossings secant", "exact")),
        ("peak-finding --crossings exact --peak-bins 64", ("--peak-bins", "--crossings secant")),
        ("peak-finding --crossings exact --root-iterations 4", ("--root-iterations", "--crossings secant")),
    ],
)
def test_an_option_that_another_s_value_makes_meaningless_is_refused(
    run: Run, options: str, named: tuple[str, ...]
) -> None:
    outcome = run(f"{RENDER} --method {options}")
    assert (outcome.status, outcome.out) == (2, "")
    for part in (*named, "leave it out"):
        assert part in outcome.err


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("post-classified --step 0", ("'0'", "--step", "above 0")),
        ("post-classified --step 1/0", ("'1/0'", "--step")),
        ("post-classified --step 1e9", ("step 1000000000.0", "64")),
        ("pre-integrated --integration 2d --table-size 4096", ("table_size 4096", "1024")),
        ("pre-integrated --sampling differential --pixel-scale 1e-9", ("pixel_scale 1e-09", "0.015625")),
        ("peak-finding --peaks 5", ("peaks 5", "1 to 4")),
        ("peak-finding --peaks few", ("'few'", "--peaks")),
        ("post-classified --jitter -1", ("'-1'", "--jitter")),
        ("post-classified --macrocells 0", ("macrocells 0", "1 to 1024")),
    ],
)
def test_a_number_out_of_range_is_refused(run: Run, options: str, named: tuple[str, ...]) -> None:
    outcome = run(f"{RENDER} --method {options}")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    for part in named:
        assert part in outcome.err


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("reference", ("neither isovalues nor steps", "exact to 1e-10", "leave it out")),
        ("peak-finding", ("--peak-weight paper", "do not converge", "--peak-weight integral")),
        ("peak-finding --peak-weight paper", ("--peak-weight paper", "do not converge")),
        ("peak-finding --peak-weight integral --peak-mode xor", ("--peak-mode xor", "leave out one")),
        ("pre-integrated --step 1/4", ("--step", "both decide about the samples", "leave out one")),
        ("post-classified --adaptive", ("--adaptive", "both decide about the samples")),
    ],
)
def test_a_tolerance_that_cannot_be_searched_for_is_refused_with_the_reason(
    run: Run, folder: Path, options: str, named: tuple[str, ...]
) -> None:
    before = content(folder)
    outcome = run(f"{RENDER} --tolerance 1/255 --method {options}")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    for part in ("--tolerance", *named):
        assert part in outcome.err
    assert content(folder) == before


@pytest.mark.parametrize("method", RAYCAST_METHODS)
def test_a_cache_folder_is_no_source_of_the_ray_caster(run: Run, cache: Path, method: str) -> None:
    outcome = run(f"render {cache.name} --method {method} -o out.png")
    assert outcome.status == 2
    for part in (cache.name, f"--method {method}", "name the volume file"):
        assert part in outcome.err


def help_of(command: str) -> dict[str, str]:
    """Return what the options of a command say, by their name in the arguments."""
    commands = next(action for action in build_parser()._actions if action.dest == "command")
    assert isinstance(commands.choices, dict)
    return {action.dest: action.help or "" for action in commands.choices[command]._actions}


def test_help_tells_the_defaults_of_the_settings() -> None:
    texts, settings = help_of("render"), RaycastSettings()
    told = {}
    for name in RAYCAST_OPTIONS:
        default = getattr(settings, name)
        word = default.value if isinstance(default, enum.Enum) else default
        if found := re.search(r"\bdefault ([^\s),]+)", texts[name]):
            told[name] = found[1]
            assert found[1] == (f"{word:g}" if isinstance(word, int | float) else word), name
        elif isinstance(default, enum.Enum):  # an alternative of several that are explained
            assert re.search(rf"(^|\W){word}\W[^:;]*.*\(default\)|: .*\(default\)", texts[name]), name
    assert {"step", "pixel_scale", "macrocells", "table_size", "peaks", "crossings", "peak_weight"} <= set(
        told
    )


def test_help_tells_the_defaults_of_a_comparison_and_of_the_filters() -> None:
    texts, sweep = help_of("compare"), Sweep()
    for name in ("steps", "pixel_scales", "per_slopes", "tolerances"):
        written = ",".join(fraction_text(value) for value in getattr(sweep, name))
        assert f"(default {written})" in texts[name]
    assert "64" in help_of("render")["macrocells"]
    texts = help_of("filter")
    defaults = {name: one.default for name, one in signature(anisotropic_diffusion).parameters.items()}
    assert f"(default {defaults['conductance']:g})" in texts["conductance"]
    assert f"(default {defaults['iterations']})" in texts["iterations"]
    assert "1/16" in texts["time_step"]  # what ITK recommends


def test_help_of_a_command_names_no_option_that_it_lacks() -> None:
    commands = next(action for action in build_parser()._actions if action.dest == "command")
    assert isinstance(commands.choices, dict)
    for name, parser in commands.choices.items():
        # What another command does may be named together with it: `render --shading`.
        texts = [re.sub(r"`[^`]*`", "", text) for text in help_of(name).values()]
        named = {option for text in texts for option in re.findall(r"--[a-z][a-z-]*", text)}
        assert named <= set(parser.option_names()), name


def test_help_tells_the_refinements_that_there_are() -> None:
    most = " or ".join(f"{edge}" for edge in REFINEMENTS[-2:])
    assert f"up to {', '.join(map(str, REFINEMENTS[1:-2]))}, {most}" in help_of("precompute")["refine"]
    assert [values.refine(str(edge)) for edge in REFINEMENTS] == list(REFINEMENTS)


def test_the_ray_caster_has_the_methods_that_are_named() -> None:
    assert tuple(kind.value for kind in Classification) == RAYCAST_METHODS
    assert set(CHOSEN_FROM) < set(COMPARED_METHODS) < set(METHODS)


@pytest.mark.parametrize("method", METHODS)
def test_help_has_an_example_of_every_method(run: Run, method: str) -> None:
    examples = run("render --help").out.partition("\nexample:\n")[2]
    assert method == "data-centric" or f"--method {method}" in examples
