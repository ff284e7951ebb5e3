"""Methods with one setting of their quality parameter each, ready to render the same frames."""

from __future__ import annotations

import enum
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from isosample.defaults import DATA_CENTRIC
from isosample.rendering.pipeline import Renderer
from isosample.rendering.preparation import prepare_surfaces
from isosample.rendering.quality import Quality
from isosample.rendering.raycast_settings import Classification, RaycastSettings, Sampling
from isosample.rendering.raycaster import RayCaster
from isosample.rendering.screen_error import settings_within
from isosample.rendering.settings import RenderSettings
from isosample.wording import fraction_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.rendering.camera import Camera
    from isosample.rendering.image import Image
    from isosample.rendering.preparation import PreparedSurfaces
    from isosample.transfer.transfer_function import TransferFunction
    from isosample.volume.grid import Volume

SAMPLE_BYTES = 4  # of the volume's texture
TRIANGLE_BYTES = 48  # of a triangle, its share of the vertices and of what the host keeps of them, about


class Parameter(enum.Enum):
    """What a method's quality is set by."""

    STEP = "step"
    PIXEL_SCALE = "s_k"
    PER_SLOPE = "isovalues per slope"
    TOLERANCE = "tolerance"


@dataclass(frozen=True, slots=True)
class Setting:
    """One method at one quality.

    Attributes
    ----------
    method : str
        One of `COMPARED_METHODS`.
    parameter : Parameter
    value : float
        Step [voxel], s_k [pixel], number of isovalues, or error [RGBA].
    """

    method: str
    parameter: Parameter
    value: float

    @property
    def label(self) -> str:
        """The quality in words, such as "step 1/4"."""
        number = fraction_text(self.value)
        if self.parameter is Parameter.PER_SLOPE:
            return f"{number} per slope"
        return f"{self.parameter.value} {number}"

    @property
    def name(self) -> str:
        """Short, for file names and identifiers; unlike those of other settings."""
        kind = {
            Parameter.STEP: "step",
            Parameter.PIXEL_SCALE: "pixels",
            Parameter.PER_SLOPE: "per-slope",
            Parameter.TOLERANCE: "tolerance",
        }[self.parameter]
        return f"{self.method}-{kind}-{fraction_text(self.value).replace('/', '-')}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedScene:
    """What every method shows, under the same conventions.

    Attributes
    ----------
    volume : Volume
    transfer_function : TransferFunction
    size : (width, height)
        Pixels.
    render : RenderSettings
        Background, clip planes, stage, and the material with which every method and the reference are lit.
    raycast : RaycastSettings
        Of the ray casters, but for classification and step. Its reconstruction is that of every method.
    nan_masked : bool
    details : int
        Coarser details of the meshes, see `Quality.details`.
    """

    volume: Volume
    transfer_function: TransferFunction
    size: tuple[int, int]
    render: RenderSettings = field(default_factory=RenderSettings)
    raycast: RaycastSettings = field(default_factory=RaycastSettings)
    nan_masked: bool = False
    details: int = 0


class Contender(Protocol):
    """A method at one setting: `prepare`, `load`, then `frame` as often as you like, then `release`."""

    setting: Setting
    precompute_seconds: float  # of what is done once per volume and transfer function, without the GPU
    bytes: int  # estimate of the memory that it holds while it is loaded: at most, until it has drawn

    def prepare(self) -> None:
        """Do what can be kept on disk: the extraction of meshes; nothing for a ray caster."""
        ...

    def load(self, cameras: Sequence[Camera]) -> float:
        """Put everything on the GPU, and choose what depends on the views that are to come; return the seconds."""
        ...

    def frame(self, camera: Camera) -> Image:
        """Draw and read back."""
        ...

    def release(self) -> None:
        """Free everything."""
        ...


def contender(scene: ComparedScene, setting: Setting) -> Contender:
    """Return the method of a setting, nothing of it done yet."""
    return (SurfaceContender if setting.method == DATA_CENTRIC else RayContender)(scene, setting)


class SurfaceContender:
    """The data-centric method: meshes, extracted once, and the A-buffer."""

    def __init__(self, scene: ComparedScene, setting: Setting) -> None:
        self._scene = scene
        self.setting = setting
        self.precompute_seconds = 0.0
        self.bytes = self._mesh_bytes = 0
        self._prepared: PreparedSurfaces | None = None
        self._renderer: Renderer | None = None
        self._settings = scene.render

    @property
    def quality(self) -> Quality:
        """How many isovalues, how fine meshes."""
        reconstruction = self._scene.raycast.reconstruction
        if self.setting.parameter is Parameter.TOLERANCE:
            asked = Quality(tolerance=self.setting.value, reconstruction=reconstruction)
        else:
            asked = Quality(per_slope=int(self.setting.value), reconstruction=reconstruction)
        return replace(asked, details=self._scene.details, lit=self._scene.render.material is not None)

    def prepare(self) -> None:
        """Plan and extract, without a cache."""
        start = time.perf_counter()
        scene = self._scene
        self._prepared = prepare_surfaces(
            scene.volume,
            scene.transfer_function,
            self.quality,
            nan_masked=scene.nan_masked,
        )
        self.precompute_seconds = time.perf_counter() - start
        surfaces = self._prepared.surfaces
        self._mesh_bytes = TRIANGLE_BYTES * sum(sum(one.statistics.triangles) for one in surfaces.by_detail)
        self.bytes = self._mesh_bytes + scene.render.fragment_budget_bytes

    def load(self, cameras: Sequence[Camera]) -> float:
        """Merge the meshes and upload the scene; with details and a tolerance, look how coarse they may be.

        The driver may put off the triangles to the first frame.
        """
        assert self._prepared is not None
        start = time.perf_counter()
        surfaces, plan = self._prepared.surfaces, self._prepared.plan
        self._renderer = Renderer(surfaces, plan)
        scene = self._scene
        self._settings = settings_within(
            self._renderer, surfaces, plan, cameras=cameras, size=scene.size, settings=scene.render
        )
        return time.perf_counter() - start

    def frame(self, camera: Camera) -> Image:
        """Build the lists, resolve them, read back."""
        assert self._renderer is not None
        image = self._renderer.render(camera=camera, size=self._scene.size, settings=self._settings)
        self.bytes = (
            self._mesh_bytes + image.stats["pool_bytes"] + image.stats["projected_bytes"]
        )  # which grows with the views, and never shrinks
        return image

    def release(self) -> None:
        """Free the GPU and the meshes."""
        if self._renderer is not None:
            self._renderer.release()
        self._renderer = self._prepared = None


class RayContender:
    """The ray caster with one classification and step."""

    def __init__(self, scene: ComparedScene, setting: Setting) -> None:
        self._scene = scene
        self.setting = setting
        self.precompute_seconds = 0.0
        self.bytes = SAMPLE_BYTES * scene.volume.array.size
        self._caster: RayCaster | None = None

    @property
    def settings(self) -> RaycastSettings:
        """The scene's, with this classification and step."""
        template = replace(self._scene.raycast, classification=Classification(self.setting.method))
        if self.setting.parameter is Parameter.PIXEL_SCALE:
            return replace(template, sampling=Sampling.DIFFERENTIAL, pixel_scale=self.setting.value)
        return replace(template, sampling=Sampling.UNIFORM, step=self.setting.value)

    def prepare(self) -> None:
        """Nothing: what a ray caster needs is made when it is loaded."""

    def load(self, cameras: Sequence[Camera]) -> float:  # noqa: ARG002  # of the protocol
        """Make the macrocells and tables, and upload the volume."""
        start = time.perf_counter()
        scene = self._scene
        self._caster = RayCaster(
            scene.volume, scene.transfer_function, raycast=self.settings, nan_masked=scene.nan_masked
        )
        return time.perf_counter() - start

    def frame(self, camera: Camera) -> Image:
        """Cast the rays, read back."""
        assert self._caster is not None
        return self._caster.render(camera=camera, size=self._scene.size, settings=self._scene.render)

    def release(self) -> None:
        """Free the GPU."""
        if self._caster is not None:
            self._caster.release()
        self._caster = None


def cost_of(stats: dict[str, Any], volume_bytes: int) -> dict[str, Any]:
    """What one picture cost, by the same names for every method; None for what a method does not have.

    Parameters
    ----------
    stats : dict
        Of the image.
    volume_bytes : int
        Of the volume's texture, which a ray caster needs.

    Returns
    -------
    cost : dict
        ``evaluations_per_ray``: samples and root evaluations of the field, or fragments of the lists;
        ``samples_per_ray``, ``most_samples``, ``root_evaluations_per_ray``, ``crossings``, ``isovalues``,
        ``fragments``, ``triangles_extracted``, ``triangles_drawn``, ``screen_error`` [pixel], ``bytes`` on the GPU
        (volume, or meshes and lists), ``skipped`` and ``not_shown`` (counts by reason).
    """
    surfaces = stats["method"] == DATA_CENTRIC
    samples = stats["samples_per_ray"]
    roots = stats.get("root_evaluations_per_ray")
    return {
        "evaluations_per_ray": samples["mean"] + (roots or 0.0),
        "samples_per_ray": samples["mean"],
        "most_samples": samples["max"],
        "root_evaluations_per_ray": roots,
        "crossings": stats.get("crossings"),
        "isovalues": len(stats["isovalues"]) if surfaces else None,
        "fragments": stats["fragments"] if surfaces else None,
        "triangles_extracted": stats["triangles"]["extracted"] if surfaces else None,
        "triangles_drawn": stats["triangles"]["drawn"] if surfaces else None,
        "screen_error": stats["screen_error"] if surfaces else None,
        "bytes": stats["mesh_bytes"] + stats["pool_bytes"] + stats["projected_bytes"]
        if surfaces
        else volume_bytes,
        "skipped": dict(stats["skipped"]),
        "not_shown": dict(stats.get("not_shown", {})),
    }
