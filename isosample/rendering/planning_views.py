"""The rays on which a plan is tried out: a few small pictures from all sides, and what they should show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from isosample.integral.reference import ReferenceTracer
from isosample.rendering.camera import Camera, UpAxis

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from isosample.rendering.settings import Material
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.geometry import Box
    from isosample.volume.grid import Volume
    from isosample.volume.reconstruction import Reconstruction

F64 = npt.NDArray[np.float64]

# Azimuth and elevation of the views [degrees] about y: from four sides, above and below, along no axis of the grid.
DEFAULT_ORBIT = ((25.0, 20.0), (115.0, -35.0), (205.0, 50.0), (295.0, -5.0))
TRUTH_SHARE = 1e-3  # the truth is known so much better than the tolerance


@dataclass(frozen=True, eq=False)
class PlanningViews:
    """Small square pictures of a volume from several cameras.

    Attributes
    ----------
    cameras : tuple of C Camera
    pixels : int
        Width and height of every picture.
    truth : (N, 4) float64
        What the C · pixels² rays show by the reference integral: premultiplied linear RGBA.
    """

    cameras: tuple[Camera, ...]
    pixels: int
    truth: F64

    @classmethod
    def trace(
        cls,
        volume: Volume,
        transfer_function: TransferFunction,
        cameras: Sequence[Camera],
        pixels: int,
        *,
        tolerance: float,
        reconstruction: Reconstruction,
        material: Material | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Self:
        """Views with their truth, which is `TRUTH_SHARE` of `tolerance` precise; errors as `ReferenceTracer`."""
        precision = min(max(TRUTH_SHARE * tolerance, 1e-12), 1e-2)
        tracer = ReferenceTracer.build(
            volume,
            transfer_function,
            tolerance=precision,
            reconstruction=reconstruction,
            material=None if material is None else material.factors,
        )
        views = cls(tuple(cameras), pixels, np.zeros((0, 4)))
        truth, _ = tracer.integrate(*views.rays, progress=progress)
        return cls(views.cameras, pixels, truth)

    @cached_property
    def rays(self) -> tuple[F64, F64]:
        """Origins and unit directions of all rays, (N, 3) each."""
        size = (self.pixels, self.pixels)
        pairs = [camera.rays(1.0).origins_and_directions(*size) for camera in self.cameras]
        return (
            np.concatenate([origins.reshape(-1, 3) for origins, _ in pairs]),
            np.concatenate([directions.reshape(-1, 3) for _, directions in pairs]),
        )

    def errors(self, rgba: npt.NDArray[np.floating[Any]]) -> F64:
        """(N,) largest difference of a component of `rgba` (N, 4) from the truth."""
        errors: F64 = np.abs(rgba - self.truth).max(axis=1)
        return errors

    def describe(self) -> list[dict[str, Any]]:
        """Return the cameras, JSON-ready."""
        return [camera.to_dict() for camera in self.cameras]


def orbit_views(box: Box) -> tuple[Camera, ...]:
    """Return the default views of a box."""
    return tuple(Camera.orbit(box, azimuth=a, elevation=e, up_axis=UpAxis.Y) for a, e in DEFAULT_ORBIT)
