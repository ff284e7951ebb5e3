"""Options that several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path

from isosample.cli import values
from isosample.defaults import (
    AUTO_DISTANCE,
    DEFAULT_MAX_ISOVALUES,
    DEFAULT_PER_SLOPE,
    DEFAULT_SCREEN_ERROR,
    DEFAULT_SIZE,
    MAX_CLIP_PLANES,
)
from isosample.surfaces.memory import DEFAULT_MEMORY
from isosample.wording import byte_size

SIZE_TEXT = "{}x{}".format(*DEFAULT_SIZE)
CACHE_VARIABLE = "ISOSAMPLE_CACHE"
CACHE_FOLDER = "meshes_cache"
CACHE_DEFAULT = f"${CACHE_VARIABLE}/NAME-HASH where that variable is set, else {CACHE_FOLDER}/NAME-HASH"


def add_volume_options(parser: argparse.ArgumentParser) -> None:
    """Add how a volume file is read."""
    group = parser.add_argument_group("reading the volume")
    group.add_argument(
        "--shape", type=values.shape, metavar="X,Y,Z", help="samples along x, y, z of a headerless file"
    )
    group.add_argument(
        "--dtype", metavar="TYPE", help="sample type of a headerless file, such as uint8 or >u2 (big-endian)"
    )
    group.add_argument(
        "--spacing",
        type=values.spacing,
        metavar="X,Y,Z",
        help="distance between samples [world]; replaces what the file says (headerless: default 1,1,1)",
    )
    group.add_argument(
        "--channel", type=values.count, metavar="N", help="channel of a file with several, counted from 0"
    )
    group.add_argument(
        "--time", type=values.count, metavar="N", help="time step of a file with several, counted from 0"
    )
    group.add_argument("--dataset", metavar="NAME", help="array of an HDF5 file or a Zarr group with several")
    group.add_argument(
        "--frame",
        choices=("world", "index"),
        help="world: placed as the file says (default); index: in its own axes, without origin and direction",
    )


def add_memory_option(parser: argparse.ArgumentParser) -> None:
    """Add how much memory an extraction may take."""
    parser.add_argument(
        "--memory",
        type=values.byte_count,
        metavar="SIZE",
        help="most memory to take, such as 2GiB: the volume is read piece by piece, every piece of a mesh is written "
        "as soon as it is there, and an interrupted run goes on where it ended (default: without limit; "
        f"{byte_size(DEFAULT_MEMORY)} for Zarr and HDF5)",
    )


def add_nan_option(parser: argparse.ArgumentParser) -> None:
    """Add what happens to samples that are not finite."""
    parser.add_argument(
        "--nan",
        choices=("masked",),
        help="masked: leave out the cells that touch a NaN or infinite sample (default: such samples are an "
        "error)",
    )


def add_plan_options(
    parser: argparse.ArgumentParser, *, without: str = "one suggested from the histogram"
) -> None:
    """Add what decides about the isovalues; `without` says what is taken where no transfer function is given."""
    parser.add_argument(
        "--tf",
        type=Path,
        metavar="FILE",
        help=f"transfer function, JSON of isosample, 3D Slicer (.vp.json) or ParaView (default: {without})",
    )
    parser.add_argument(
        "--per-slope",
        type=values.count,
        metavar="K",
        help=f"isovalues inside each visible slope of the transfer function (default {DEFAULT_PER_SLOPE})",
    )


def add_quality_options(parser: argparse.ArgumentParser, *, searched: str = "refinement are") -> None:
    """Add what decides about the meshes, and the search for isovalues; `searched` says what else a tolerance means."""
    parser.add_argument(
        "--tolerance",
        type=values.tolerance,
        metavar="E",
        help="in place of --per-slope: largest error of a component, such as 1/255, for all but a thousandth of the "
        f"pixels; isovalues and {searched} searched for on pictures from four sides, without light",
    )
    parser.add_argument(
        "--max-isovalues",
        type=values.count,
        metavar="N",
        help=f"at most so many isovalues for a tolerance (default {DEFAULT_MAX_ISOVALUES})",
    )
    add_reconstruction_option(parser)
    parser.add_argument(
        "--refine",
        type=values.refine,
        metavar="N",
        help="divide the edges of bent triangles into up to 2, 4 or 8, with the new corners on the isosurface; auto: "
        f"until the meshes are within {AUTO_DISTANCE:g} voxel of it, a cache folder keeping those that were tried "
        "(default 1; with --tolerance: the most that may be chosen, 8)",
    )


def add_shading_option(group: argparse.ArgumentParser | argparse._ArgumentGroup, *, does: str) -> None:
    """Add the light; `does` says what comes of it here."""
    group.add_argument("--shading", action="store_true", help=does)


def add_details_option(
    parser: argparse.ArgumentParser, *, within: str = "that `render --screen-error` allows"
) -> None:
    """Add how many coarser meshes are made besides; `within` says how far off those of a picture may be."""
    parser.add_argument(
        "--details",
        type=values.details,
        metavar="N",
        help="make N coarser meshes too (1 to 5: within 1/32, 1/16, … 1/2 voxel of the isosurfaces); a picture takes "
        f"the coarsest {within}: pays for films and for meshes that are rendered often "
        "(default 0)",
    )


def add_reconstruction_option(parser: argparse.ArgumentParser) -> None:
    """Add what the field is between the samples."""
    parser.add_argument(
        "--reconstruction",
        choices=("trilinear", "cubic", "catmull-rom", "bspline", "bc21"),
        help="field between the samples: trilinear (default); cubic, the smooth spline through them, and catmull-rom, "
        "which reaches two samples far; bspline and bc21 smooth the samples too",
    )


def add_camera_options(parser: argparse.ArgumentParser) -> None:
    """Add where the picture is taken from."""
    group = parser.add_argument_group("camera")
    group.add_argument(
        "--camera", type=Path, metavar="FILE", help="JSON file of a camera, in place of the options below"
    )
    group.add_argument(
        "--azimuth",
        type=values.finite,
        metavar="D",
        help="degrees by which the eye turns towards +x about the box's centre (default 0)",
    )
    group.add_argument(
        "--elevation",
        type=values.finite,
        metavar="D",
        help="degrees by which the eye turns upwards (default 0)",
    )
    group.add_argument(
        "--up",
        choices=("y", "z"),
        help="axis that points up: y, the eye starting on +z, or z, the eye starting on -y, which is a patient's "
        "front (default z for NIfTI, MetaImage, DICOM and NRRD with an anatomical space, else y)",
    )
    group.add_argument(
        "--zoom",
        type=values.zoom,
        metavar="F",
        help=f"magnification, {1 / values.LARGEST_ZOOM:g} to {values.LARGEST_ZOOM:g}; 1 "
        "fits the bounding sphere of --fit's box (default 1)",
    )
    group.add_argument(
        "--fit",
        choices=("volume", "visible"),
        help="the box that the eye turns about and that fills the picture: all of the volume (default), or the cells "
        "of which the transfer function shows something in the trilinear field, whatever clip planes cut away; a "
        "smooth --reconstruction may show more beyond them",
    )
    group.add_argument(
        "--projection", choices=("orthographic", "perspective"), help="kind of camera (default orthographic)"
    )


def add_picture_options(parser: argparse.ArgumentParser) -> None:
    """Add what the picture looks like."""
    group = parser.add_argument_group("picture")
    group.add_argument(
        "--size",
        type=values.picture_size,
        default=DEFAULT_SIZE,
        metavar="WxH",
        help=f"width and height [pixel] (default {SIZE_TEXT})",
    )
    group.add_argument(
        "--segment",
        choices=("constant", "linear", "cubic"),
        default="cubic",
        help="course of the data between two crossings of a ray; cubic uses the slopes there (default cubic)",
    )
    group.add_argument(
        "--curved",
        action=argparse.BooleanOptionalAction,
        help="move every crossing from its triangle onto the curved surface through the corners (default: with the "
        "smooth reconstructions)",
    )
    group.add_argument(
        "--screen-error",
        type=values.screen_error,
        metavar="PX",
        help="how far coarser meshes may be from the finest in the picture [pixel], where there are --details; 0: show "
        f"the finest (default {DEFAULT_SCREEN_ERROR:g}, with a tolerance as much of it as that allows)",
    )
    group.add_argument(
        "--segment-opacity",
        choices=("exponential", "first-order"),
        help="opacity of a constant segment of optical depth x: 1 - exp(-x) (default), or x as in eq. 3 of "
        "Lindholm et al.",
    )
    add_shading_option(
        group,
        does="light the volume from the eye (default: colours as they are); slopes of constant extinction and colour "
        "then get isovalues too. --tolerance searches without light; with isosurfaces it tells the error of the lit "
        "pictures",
    )
    add_look_options(group, displayed="; .mp4 and .gif show that over black")


def add_look_options(group: argparse._ArgumentGroup, *, displayed: str) -> None:
    """Add clip planes, background and shader stage; `displayed` says how a transparent background is displayed."""
    group.add_argument(
        "--clip",
        type=values.clip_plane,
        action="append",
        default=[],
        metavar="NX,NY,NZ,D",
        help=f"keep what has nx x + ny y + nz z + d >= 0 [world]; up to {MAX_CLIP_PLANES} times "
        "(default: nothing is cut)",
    )
    group.add_argument(
        "--background",
        type=values.background,
        default=(0.0, 0.0, 0.0, 0.0),
        metavar="R,G,B[,A]",
        help=f"linear colour behind the volume, each part in [0, 1] (default transparent{displayed})",
    )
    group.add_argument(
        "--stage",
        choices=("auto", "fragment", "compute"),
        default="auto",
        help="shader stage that sorts and integrates, or casts the rays (default auto: fragment on software renderers)",
    )
