"""Pictures of the ray caster's methods against the float64 reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from isosample.errors import CapacityError, InputError
from isosample.rendering.camera import Camera
from isosample.rendering.device_transfer import DeviceTransfer
from isosample.rendering.raycast_settings import (
    Classification,
    Crossings,
    Integration,
    PeakMode,
    PeakWeight,
    RaycastSettings,
    TableDtype,
)
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.reference_image import render_reference
from isosample.rendering.scene import ValueScale
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction
from isosample.volume.grid import Volume

if TYPE_CHECKING:
    import moderngl

    from isosample.volume.grid import F64

EDGE, PIXELS = 24, 32
EIGHT_BITS = 0.5 / 255.0
ORANGE, BLUE = (1.0, 0.4, 0.1), (0.1, 0.3, 1.0)


def rough_volume() -> Volume:
    """Smoothed noise in [0, 1]; float32."""
    noise = np.random.default_rng(7).random((EDGE, EDGE, EDGE))
    for axis in range(3):
        noise = noise + np.roll(noise, -1, axis) + np.roll(noise, 1, axis)
    samples = (noise - noise.min()) / (noise.max() - noise.min())
    return Volume(samples.astype(np.float32))


def tent(
    centre: float, half_width: float, area: float, color: tuple[float, float, float]
) -> list[ControlPoint]:
    """Three control points of a peak."""
    return [
        ControlPoint(centre - half_width, color, 0.0),
        ControlPoint(centre, color, area / half_width),
        ControlPoint(centre + half_width, color, 0.0),
    ]


SMOOTH = TransferFunction([*tent(0.3, 0.2, 0.05, ORANGE), *tent(0.7, 0.15, 0.05, BLUE)])
DIRAC = TransferFunction(
    [*tent(0.4, 5e-5, 0.02, ORANGE), *tent(0.6, 5e-5, 0.02, BLUE)], [Isosurface(0.5, (1.0, 1.0, 1.0), 0.1)]
)
MANY = TransferFunction(
    [], [Isosurface(v, (1.0 - v, v, 0.5), 0.05) for v in np.linspace(0.0051, 0.9953, 128).tolist()]
)
EXACT = RaycastSettings(
    classification=Classification.PEAK_FINDING,
    crossings=Crossings.EXACT,
    peak_weight=PeakWeight.INTEGRAL,
    step=1.0,
)


def camera(volume: Volume) -> Camera:
    """Oblique."""
    return Camera.orbit(volume.box, azimuth=31.0, elevation=17.0)


def difference(transfer_function: TransferFunction, settings: RaycastSettings) -> F64:
    """(PIXELS, PIXELS, 4) ray caster less reference."""
    volume = rough_volume()
    view = camera(volume)
    with RayCaster(volume, transfer_function, raycast=settings) as caster:
        found = caster.render(camera=view, size=(PIXELS, PIXELS))
    expected = render_reference(volume, transfer_function, camera=view, size=(PIXELS, PIXELS))
    return found.rgba.astype(np.float64) - expected.rgba


def rms(error: F64) -> float:
    """Root of the mean square."""
    return float(np.sqrt((error**2).mean()))


@pytest.mark.parametrize("weight", list(PeakWeight))
@pytest.mark.parametrize("step", [1.0, 4.0])
def test_128_impulses_are_exact_at_one_voxel_steps_and_longer_ones(
    gl: moderngl.Context, weight: PeakWeight, step: float
) -> None:
    settings = RaycastSettings(
        classification=Classification.PEAK_FINDING, crossings=Crossings.EXACT, peak_weight=weight, step=step
    )
    # No crossing is lost or doubled: a single one would be 0.05 times the light that reaches it.
    assert np.abs(difference(MANY, settings)).max() < 1e-4 < EIGHT_BITS


def test_exact_crossings_converge_to_the_reference_on_narrow_peaks(gl: moderngl.Context) -> None:
    # Values of a ray are known to 2^-23 of the range, a peak is 1e-4 wide: 1e-3 of its optical depth.
    assert np.abs(difference(DIRAC, EXACT)).max() < 1e-3


def test_exact_crossings_integrate_a_smooth_transfer_function(gl: moderngl.Context) -> None:
    # Three Gauss nodes on panels of depth 1 at most in every cell: see test_classification.py.
    assert np.abs(difference(SMOOTH, EXACT)).max() < 1e-4


def test_pre_integration_converges_in_second_order(gl: moderngl.Context) -> None:
    coarse, fine = (rms(difference(SMOOTH, RaycastSettings(step=step))) for step in (0.5, 0.125))
    assert np.log2(coarse / fine) / 2.0 > 1.5


def test_the_paper_s_weight_stays_away_from_the_integral(gl: moderngl.Context) -> None:
    errors = [
        rms(
            difference(DIRAC, RaycastSettings(classification=Classification.PEAK_FINDING, peaks=4, step=step))
        )
        for step in (1.0, 0.25)
    ]
    assert min(errors) > 20.0 * rms(difference(DIRAC, EXACT))
    assert min(errors) > EIGHT_BITS


def test_what_cannot_be_shown_is_said(gl: moderngl.Context) -> None:
    volume = rough_volume()
    for settings, hidden in (
        (RaycastSettings(classification=Classification.POST_CLASSIFIED), {"isosurfaces": 128}),
        (
            RaycastSettings(classification=Classification.PEAK_FINDING, peak_mode=PeakMode.DVR_ONLY),
            {"isosurfaces": 128},
        ),
        (RaycastSettings(integration=Integration.TABLE_1D), {"isosurfaces": 128}),
        (RaycastSettings(), {}),
    ):
        with RayCaster(volume, MANY, raycast=settings) as caster:
            image = caster.render(camera=camera(volume), size=(8, 8))
        assert image.stats["not_shown"] == hidden
        assert bool(image.rgba.any()) != bool(hidden)


def test_a_table_that_is_too_large_is_refused(gl: moderngl.Context) -> None:
    settings = RaycastSettings(integration=Integration.TABLE_3D, table_size=1024)
    with pytest.raises(CapacityError, match="--table-size 819"):
        DeviceTransfer(gl, SMOOTH, ValueScale(0.0, 1.0), settings, 0.5)


def test_integrals_in_half_precision_are_refused() -> None:
    with pytest.raises(InputError, match=r"table_dtype float16 goes with integration 2d and 3d, not 1d"):
        RaycastSettings(integration=Integration.TABLE_1D, table_dtype=TableDtype.FLOAT16)


@pytest.mark.parametrize("crossings", Crossings)
def test_exact_shares_in_place_of_samples_are_refused(crossings: Crossings) -> None:
    # The share of a peak is that of the stretch around it, samples included: there is nothing to leave out.
    with pytest.raises(InputError, match=r"peak_mode xor goes with peak_weight paper, not integral"):
        RaycastSettings(
            classification=Classification.PEAK_FINDING,
            crossings=crossings,
            peak_mode=PeakMode.XOR,
            peak_weight=PeakWeight.INTEGRAL,
        )
