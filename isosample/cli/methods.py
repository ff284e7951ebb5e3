"""Which options of `isosample render` belong to which method; one that belongs to another is an error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isosample.defaults import (
    CHOSEN_FROM,
    COMPARED_METHODS,
    DATA_CENTRIC,
    EXACT_PEAKS,
    PEAK_FINDING,
    POST_CLASSIFIED,
    PRE_INTEGRATED,
    RAYCAST_METHODS,
    REFERENCE,
)
from isosample.errors import InputError

if TYPE_CHECKING:
    import argparse

METHODS = (*COMPARED_METHODS, REFERENCE)
AUTO = "auto"
STEP_OPTIONS = ("step", "sampling", "pixel_scale", "adaptive", "jitter")  # a tolerance decides in their place

SURFACE_OPTIONS = {  # with their defaults
    "cache": None,
    "per_slope": None,
    "max_isovalues": None,
    "refine": None,
    "plan": False,
    "details": None,
    "screen_error": None,
    "segment": "cubic",
    "segment_opacity": None,
    "curved": None,
    "strict": False,
    "error_map": None,
    "mesh_budget": None,
}
RAYCAST_OPTIONS = {  # None unless given; the methods that each belongs to
    "step": RAYCAST_METHODS,
    "sampling": RAYCAST_METHODS,
    "pixel_scale": RAYCAST_METHODS,
    "adaptive": RAYCAST_METHODS,
    "jitter": RAYCAST_METHODS,
    "filtering": RAYCAST_METHODS,
    "skipping": RAYCAST_METHODS,
    "macrocells": RAYCAST_METHODS,
    "transfer_lookup": (POST_CLASSIFIED, PEAK_FINDING),
    "quadrature": (POST_CLASSIFIED, PEAK_FINDING),
    "integration": (PRE_INTEGRATED,),
    "table_size": (PRE_INTEGRATED,),
    "table_dtype": (PRE_INTEGRATED,),
    "peak_mode": (PEAK_FINDING,),
    "peak_weight": (PEAK_FINDING,),
    "crossings": (PEAK_FINDING,),
    "peak_bins": (PEAK_FINDING,),
    "peaks": (PEAK_FINDING,),
    "root_iterations": (PEAK_FINDING,),
}
NEEDS = {  # options that say something only with certain values of another, whose default stands first
    "step": ("sampling", ("uniform",), "uniform"),
    "pixel_scale": ("sampling", ("differential",), "uniform"),
    "table_size": ("integration", ("2d", "3d"), "exact"),
    "table_dtype": ("integration", ("2d", "3d"), "exact"),
    "peak_bins": ("crossings", ("secant",), "secant"),
    "peaks": ("crossings", ("secant",), "secant"),
    "root_iterations": ("crossings", ("secant",), "secant"),
}
WRITTEN = {
    "skipping": "--no-skipping",
    "transfer_lookup": "--transfer",
}  # where it is not the name with dashes


def check_method(args: argparse.Namespace) -> None:
    """Raise `InputError` for an option that belongs to another method, or to another option's value.

    Parameters
    ----------
    args : Namespace
        Of `isosample render`.
    """
    if args.method == AUTO:
        check_tolerance(args)
        methods_left(args)
        _check_needs(args)
        return
    if args.method != DATA_CENTRIC:
        _refuse_surface_options(args)
        check_tolerance(args)
    if args.method == REFERENCE and args.stage != "auto":
        raise InputError(
            f"--stage {args.stage} is about OpenGL, and --method reference has none; leave it out."
        )
    for name, methods in RAYCAST_OPTIONS.items():
        if getattr(args, name) is not None and args.method not in methods:
            _refuse_raycast_option(option(name), args.method, methods)
    _check_needs(args)


def methods_left(args: argparse.Namespace) -> list[str]:
    """Methods among which `auto` may choose: those that have all the options that are given.

    Raises
    ------
    InputError
        If there are none; two options that no method has both are named.
    """
    left = list(CHOSEN_FROM)
    given: list[tuple[str, tuple[str, ...]]] = [
        (name, (DATA_CENTRIC,)) for name, default in SURFACE_OPTIONS.items() if getattr(args, name) != default
    ]
    given += [(name, owners) for name, owners in RAYCAST_OPTIONS.items() if getattr(args, name) is not None]
    for name, owners in given:
        fitting = [method for method in left if method in owners]
        if not fitting:
            before = next(
                other for other, theirs in given if not set(theirs) & set(owners) & set(CHOSEN_FROM)
            )
            raise InputError(
                f"{option(name)} belongs to --method {' and '.join(owners)}, and {option(before)} does not; leave out "
                "one of them."
            )
        left = fitting
    return left


def check_tolerance(args: argparse.Namespace) -> None:
    """Raise `InputError` for a tolerance that a method without isosurfaces cannot search for, with the reason."""
    if args.tolerance is None:
        return
    given = f"--tolerance {args.tolerance:g}"
    if args.method == REFERENCE:
        raise InputError(
            f"{given} is what pictures may err from --method reference, which is exact to 1e-10 and has neither "
            "isovalues nor steps to search for; leave it out."
        )
    placed = [name for name in STEP_OPTIONS if getattr(args, name) is not None]
    if placed:
        raise InputError(
            f"{given} and {option(placed[0])} both decide about the samples; leave out one of them."
        )
    if args.method not in (PEAK_FINDING, AUTO) or args.peak_mode == "dvr-only":
        return
    if args.peak_mode is not None and args.peak_mode != "both":
        raise InputError(
            f"{given} is measured against the whole integral, and --peak-mode {args.peak_mode} leaves parts of it out; "
            "leave out one of them."
        )
    begins_with = EXACT_PEAKS["peak_weight"] if args.method == AUTO else "paper"
    weight = args.peak_weight or begins_with
    if weight == "paper":
        raise InputError(
            f"{given} cannot be searched for with --peak-weight paper: the paper's weights do not converge to the "
            "integral, however short the steps; add --peak-weight integral (and --crossings exact), or leave it out."
        )


def _check_needs(args: argparse.Namespace) -> None:
    """Raise where an option says nothing with the value of another."""
    for name, (other, fitting, default) in NEEDS.items():
        chosen = getattr(args, other) or default
        if getattr(args, name) is not None and chosen not in fitting:
            raise InputError(
                f"{option(name)} goes with {option(other)} {' or '.join(fitting)}, not {chosen}; leave it out, or add "
                f"{option(other)} {fitting[0]}."
            )


def choice_statistics(args: argparse.Namespace) -> dict[str, Any]:
    """What the statistics say about an automatic choice; nothing without one."""
    return {} if args.choice is None else {"choice": args.choice}


def check_volume_is_named(args: argparse.Namespace) -> None:
    """Raise `InputError` if the source of a method that needs the volume is a cache folder."""
    from isosample.cli.sources import is_cache_folder

    if is_cache_folder(args.source):
        raise InputError(
            f"{args.source} is a mesh cache, and --method {args.method} integrates the volume itself; name the volume "
            "file."
        )


def option(name: str) -> str:
    """The option as it is written on the command line."""
    return WRITTEN.get(name, f"--{name.replace('_', '-')}")


def _refuse_surface_options(args: argparse.Namespace) -> None:
    for name, default in SURFACE_OPTIONS.items():
        if getattr(args, name) != default:
            raise InputError(
                f"{option(name)} is about isosurfaces (--method {DATA_CENTRIC}), and --method {args.method} has none; "
                "leave it out."
            )


def _refuse_raycast_option(written: str, method: str, methods: tuple[str, ...]) -> None:
    owner = "the ray caster" if methods == RAYCAST_METHODS else f"--method {' and '.join(methods)}"
    advice = PRE_INTEGRATED if PRE_INTEGRATED in methods else methods[-1]
    raise InputError(
        f"{written} belongs to {owner}, and the method is {method}; leave it out, or choose --method {advice}."
    )
