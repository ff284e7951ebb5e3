"""How the ray caster samples and classifies, besides what every picture has (`RenderSettings`)."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from isosample import defaults
from isosample.defaults import (
    DEFAULT_PEAK_BINS,
    DEFAULT_PEAKS,
    DEFAULT_PIXEL_SCALE,
    DEFAULT_ROOT_ITERATIONS,
    DEFAULT_STEP,
    DEFAULT_TABLE_SIZE,
    MACROCELLS,
    MOST_PEAKS,
    PEAK_BIN_RANGE,
    TABLE_SIZE_RANGE,
)
from isosample.errors import InputError
from isosample.volume.reconstruction import Reconstruction

SMALLEST_STEP, LARGEST_STEP = 1.0 / 1024.0, 64.0  # [voxel]
SMALLEST_PIXEL_SCALE, LARGEST_PIXEL_SCALE = 1.0 / 64.0, 1024.0


class Classification(enum.Enum):
    """What is made of the values along a ray."""

    POST_CLASSIFIED = defaults.POST_CLASSIFIED
    PRE_INTEGRATED = defaults.PRE_INTEGRATED
    PEAK_FINDING = defaults.PEAK_FINDING


class Sampling(enum.Enum):
    """Where along a ray the field is sampled: even steps, or steps that grow with the distance from the eye."""

    UNIFORM = "uniform"
    DIFFERENTIAL = "differential"


class Quadrature(enum.Enum):
    """Post-classified stretches: by the sample at their front (order 1), or by both ends (order 2)."""

    RIEMANN = "riemann"
    TRAPEZOID = "trapezoid"


class Integration(enum.Enum):
    """Pre-integrated stretches: piece by piece of the transfer function, or from a table.

    `TABLE_1D`: integrals of the transfer function over the value, 8192 of them: the exact opacity of any length,
    the mean colour of a stretch, no isosurfaces. `TABLE_2D`: by the values at both ends, for one length; `TABLE_3D`:
    for many.
    """

    EXACT = "exact"
    TABLE_1D = "1d"
    TABLE_2D = "2d"
    TABLE_3D = "3d"


class TableDtype(enum.Enum):
    """Numbers of the tables by the values at both ends of a stretch."""

    FLOAT32 = "float32"
    FLOAT16 = "float16"


class TransferLookup(enum.Enum):
    """The transfer function at a value: straight lines between its points, or a texture of 8192 entries."""

    EXACT = "exact"
    TEXTURE = "texture"


class PeakMode(enum.Enum):
    """What peak finding shows: samples and peaks, peaks in place of samples, or one of the two alone."""

    BOTH = "both"
    XOR = "xor"
    PEAK_ONLY = "peak-only"
    DVR_ONLY = "dvr-only"


class PeakWeight(enum.Enum):
    """Opacity of a peak: the extinction over a length of 1 (the paper), or its exact share of the integral."""

    PAPER = "paper"
    INTEGRAL = "integral"


class Crossings(enum.Enum):
    """Where a stretch crosses a peak: rule of signs and secant steps, or all roots of every cell's cubic."""

    SECANT = "secant"
    EXACT = "exact"


class Filtering(enum.Enum):
    """Who interpolates: the shader in float32, or the texture unit (some GPUs: 8-bit fractions)."""

    SHADER = "shader"
    HARDWARE = "hardware"


@dataclass(frozen=True, slots=True, kw_only=True)
class RaycastSettings:
    """Settings of the ray caster.

    Attributes
    ----------
    classification : Classification
    sampling : Sampling
    step : float
        Uniform sampling: distance between samples [voxel, the smallest spacing].
    pixel_scale : float
        Differential sampling: s_k of Knoll et al. 2009, the first step in pixels of an image plane one voxel
        in front of the eye.
    adaptive : bool
        Whether the step of every macrocell is a multiple 2/m + 1 of the base step, m being the largest
        standard deviation of its cells over that of the volume (eq. 8 of Knoll et al. 2010).
    jitter : int or None
        Seed of a shift of every ray's samples by a part of a step; None: no shift.
    quadrature : Quadrature
    integration : Integration
    table_size : int
        Values along an edge of the pre-integration table (2d, 3d).
    table_dtype : TableDtype
        Numbers of that table. Half precision rounds its entries by at most 2⁻¹¹ of themselves, and pictures by
        less than 1.5e-3.
    transfer_lookup : TransferLookup
    peak_mode : PeakMode
    peak_weight : PeakWeight
    crossings : Crossings
    peak_bins : int
        Values along an edge of the peak table.
    peaks : int
        Most peaks between two samples that the table holds, 1 to 4; exact crossings find all of them.
    root_iterations : int
        Secant steps.
    reconstruction : Reconstruction
    filtering : Filtering
    skipping : bool
        Whether empty macrocells are leapt over.
    macrocells : int
        Macrocells along the longest axis, at most.

    Raises
    ------
    InputError
        If a number is out of range; if integrals over the value are asked for in half precision: what is read from them
        are small differences; or if peaks are to stand in place of samples with the share of the integral, which holds
        both.
    """

    classification: Classification = Classification.PRE_INTEGRATED
    sampling: Sampling = Sampling.UNIFORM
    step: float = DEFAULT_STEP
    pixel_scale: float = DEFAULT_PIXEL_SCALE
    adaptive: bool = False
    jitter: int | None = None
    quadrature: Quadrature = Quadrature.TRAPEZOID
    integration: Integration = Integration.EXACT
    table_size: int = DEFAULT_TABLE_SIZE
    table_dtype: TableDtype = TableDtype.FLOAT32
    transfer_lookup: TransferLookup = TransferLookup.EXACT
    peak_mode: PeakMode = PeakMode.BOTH
    peak_weight: PeakWeight = PeakWeight.PAPER
    crossings: Crossings = Crossings.SECANT
    peak_bins: int = DEFAULT_PEAK_BINS
    peaks: int = DEFAULT_PEAKS
    root_iterations: int = DEFAULT_ROOT_ITERATIONS
    reconstruction: Reconstruction = Reconstruction.TRILINEAR
    filtering: Filtering = Filtering.SHADER
    skipping: bool = True
    macrocells: int = MACROCELLS

    def __post_init__(self) -> None:
        _check_between("step", self.step, SMALLEST_STEP, LARGEST_STEP, "voxels")
        _check_between("pixel_scale", self.pixel_scale, SMALLEST_PIXEL_SCALE, LARGEST_PIXEL_SCALE, "pixels")
        _check_whole("table_size", self.table_size, *TABLE_SIZE_RANGE)
        _check_whole("peak_bins", self.peak_bins, *PEAK_BIN_RANGE)
        _check_whole("peaks", self.peaks, 1, MOST_PEAKS)
        _check_whole("root_iterations", self.root_iterations, 0, 64)
        _check_whole("macrocells", self.macrocells, 1, 1024)
        if self.integration is Integration.TABLE_1D and self.table_dtype is TableDtype.FLOAT16:
            raise InputError(
                "table_dtype float16 goes with integration 2d and 3d, not 1d, from which small differences are read; "
                "use float32."
            )
        if self.peak_mode is PeakMode.XOR and self.peak_weight is PeakWeight.INTEGRAL:
            raise InputError(
                "peak_mode xor goes with peak_weight paper, not integral, with which a peak holds its share of what "
                "lies between the samples; use peak_mode both."
            )
        if self.jitter is not None:
            _check_whole("jitter", self.jitter, 0, 2**32 - 2)


def _check_between(name: str, number: float, low: float, high: float, unit: str) -> None:
    if not (math.isfinite(number) and low <= number <= high):
        raise InputError(f"{name} {number!r} must be a number of {unit} from {low:g} to {high:g}.")


def _check_whole(name: str, number: object, low: int, high: int) -> None:
    if isinstance(number, bool) or not isinstance(number, int) or not low <= number <= high:
        raise InputError(f"{name} {number!r} must be a whole number from {low} to {high}.")
