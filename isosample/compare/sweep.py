"""Which settings a comparison sweeps: every method from coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass

from isosample.compare.contenders import Parameter, Setting
from isosample.defaults import (
    COMPARED_METHODS,
    DATA_CENTRIC,
    DEFAULT_PER_SLOPES,
    DEFAULT_PIXEL_SCALES,
    DEFAULT_STEPS,
    DEFAULT_TOLERANCES,
)
from isosample.errors import InputError
from isosample.rendering.raycast_settings import Sampling


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The settings of every method, from coarse to fine.

    Attributes
    ----------
    methods : tuple of str
        Of `COMPARED_METHODS`.
    steps : tuple of float
        Ray casters, uniform sampling [voxel].
    pixel_scales : tuple of float
        Ray casters, differential sampling: s_k.
    per_slopes : tuple of int
        Isovalues inside each slope.
    tolerances : tuple of float
        Errors that isovalues and refinement are searched for.

    Raises
    ------
    InputError
        If a method is unknown or comes twice, or there is none.
    """

    methods: tuple[str, ...] = COMPARED_METHODS
    steps: tuple[float, ...] = DEFAULT_STEPS
    pixel_scales: tuple[float, ...] = DEFAULT_PIXEL_SCALES
    per_slopes: tuple[int, ...] = DEFAULT_PER_SLOPES
    tolerances: tuple[float, ...] = DEFAULT_TOLERANCES

    def __post_init__(self) -> None:
        if not self.methods or len(set(self.methods)) != len(self.methods):
            raise InputError(f"methods {self.methods} must be one or more, each once.")
        for method in self.methods:
            if method not in COMPARED_METHODS:
                raise InputError(f"method {method!r} must be one of {', '.join(COMPARED_METHODS)}.")

    def settings(self, sampling: Sampling) -> list[list[Setting]]:
        """Return the settings of every method, from coarse to fine.

        Parameters
        ----------
        sampling : Sampling
            Whether ray casters are swept by step or by s_k.
        """
        rays, values = (
            (Parameter.STEP, self.steps)
            if sampling is Sampling.UNIFORM
            else (Parameter.PIXEL_SCALE, self.pixel_scales)
        )
        surfaces = [(Parameter.PER_SLOPE, float(number)) for number in self.per_slopes]
        surfaces += [(Parameter.TOLERANCE, error) for error in self.tolerances]
        swept = {
            method: surfaces if method == DATA_CENTRIC else [(rays, value) for value in values]
            for method in self.methods
        }
        return [[Setting(method, *choice) for choice in choices] for method, choices in swept.items()]


QUICK = Sweep(steps=(2.0, 0.5), pixel_scales=(8.0, 2.0), per_slopes=(1, 5), tolerances=())
