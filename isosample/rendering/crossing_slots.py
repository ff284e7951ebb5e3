"""Slots: room for so many crossings of every pixel of a tile, in place of linked lists."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isosample.gl.buffer_image import BufferImage, texel_bytes
from isosample.gl.context import limits
from isosample.gl.memory import with_room
from isosample.rendering.fragment_pool import step_bytes
from isosample.rendering.frame import shared_constants
from isosample.rendering.stage import LINE_GROUP, MOST_GROUPS
from isosample.rendering.supplies import storage_bindings
from isosample.tally import POOLS, tally

if TYPE_CHECKING:
    import moderngl

    from isosample.rendering.tiles import Tile

# Classes of packets by their longest list, as in pass/packets.glsl: runs of so many crossings, and how many of them.
CLASSES = (
    (8, 0),
    (8, 1),
    (12, 1),
    (16, 1),
    (12, 2),
    (16, 2),
    (16, 3),
    (16, 4),
    (16, 6),
    (16, 8),
    (16, 12),
    (16, 16),
)
MOST_SLOT_GROUPS = CLASSES[-1][1]  # of slots: what the last class takes
SLOT_TEXELS = {"slots": "rg32ui", "slot_normals": "r32ui"}  # by image; normals are those of lit pictures
MOST_PIXELS = MOST_GROUPS * LINE_GROUP  # of a tile: one call of a shader takes all of them
WORD = 4  # bytes
NODE_SHARE = 1 / 8  # of the budget is kept for the nodes of lists that are no chains
REMEDY = "Render with RenderSettings(build_stage=BuildStage.FRAGMENT), which needs none."


class CrossingSlots:
    """The slots, and the packets of pixels by the longest of their lists.

    Parameters
    ----------
    ctx : moderngl.Context
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._images: dict[str, BufferImage] = {}
        self._packets: moderngl.Buffer | None = None
        self._tile_packets = 0

    def release(self) -> None:
        """Free everything."""
        for image in self._images.values():
            image.release()
        if self._packets is not None:
            self._packets.release()
        self._images, self._packets = {}, None

    @property
    def size_bytes(self) -> int:
        """Memory of the slots."""
        return sum(image.size_bytes for image in self._images.values())

    @property
    def constants(self) -> dict[str, int]:
        """Of the shaders that fill slots."""
        return {"BEYOND_BLOCK": int(self._images["slots"].beyond_block)}

    def bytes_with(self, tile: Tile, groups: int, *, lit: bool) -> int:
        """Memory of the slots once there is room for groups of them for every pixel of a tile, and what is held."""
        sizes = {name: image.size_bytes for name, image in self._images.items()}
        for name in image_names(lit=lit):
            needed = slot_total(tile, groups) * texel_bytes(SLOT_TEXELS[name])
            sizes[name] = max(sizes.get(name, 0), needed)
        return sum(sizes.values())

    def most_rows(self, width: int, groups: int, *, lit: bool, budget_bytes: int) -> int:
        """Rows of a tile `width` pixels wide whose slots fit the budget and the driver; whole packets of them.

        There is then room for some of the lists as linked ones in the fragment pool, too, which grows in whole steps.
        """
        constants = shared_constants()
        row = _packets(width, constants["PACKET_WIDTH"]) * constants["PACKET_PIXELS"] * groups
        most = self._most_crossings(lit=lit, budget_bytes=budget_bytes)
        packets = min(most // (row * constants["SLOT_GROUP"]), MOST_PIXELS * groups // row)
        return packets * constants["PACKET_HEIGHT"]

    def begin_tile(self, tile: Tile, groups: int, *, lit: bool, budget_bytes: int) -> None:
        """Make room for groups of slots of every pixel, and empty the classes; parameters as `most_rows`.

        Raises
        ------
        CapacityError
            If the driver has no room.
        """
        self._tile_packets = packet_total(tile)
        self._release_above(self._most_crossings(lit=lit, budget_bytes=budget_bytes), lit=lit)
        for name in image_names(lit=lit):
            self._reserve(name, slot_total(tile, groups))
        size = WORD * (len(CLASSES) * (1 + self._tile_packets) + tile.pixel_count)
        if self._packets is None or self._packets.size < size:
            if self._packets is not None:
                self._packets.release()
            self._packets = None
            buffer = self._ctx.buffer(reserve=size)
            self._packets = with_room(self._ctx, buffer, "packets of pixels", size, REMEDY)
        self._packets.write(np.zeros(len(CLASSES), dtype=np.uint32))

    def bind(self) -> None:
        """Bind the slots and the packets."""
        for name, image in self._images.items():
            image.bind_image(shared_constants()[f"BINDING_{name.upper()}"])
        if self._images:
            self._images["slots"].bind_storage(storage_bindings()["SlotStore"])
        if self._packets is not None:
            self._packets.bind_to_storage_buffer(storage_bindings()["Packets"])

    def packets(self) -> list[tuple[int, int]]:
        """First packet of every class in the buffer, and how many there are."""
        assert self._packets is not None
        counts = np.frombuffer(self._packets.read(size=WORD * len(CLASSES)), dtype=np.uint32).tolist()
        return [(len(CLASSES) + i * self._tile_packets, count) for i, count in enumerate(counts)]

    def _most_crossings(self, *, lit: bool, budget_bytes: int) -> int:
        nodes = max(int(NODE_SHARE * budget_bytes), step_bytes())
        room = max(budget_bytes - nodes, 0)
        return min(room // crossing_bytes(lit=lit), limits(self._ctx).buffer_texels)

    def _release_above(self, crossings: int, *, lit: bool) -> None:
        """Free what is left of a picture with a larger budget, or with light."""
        for name, image in list(self._images.items()):
            too_large = image.size_bytes > crossings * texel_bytes(SLOT_TEXELS[name])
            if too_large or (name == "slot_normals" and not lit):
                self._images.pop(name).release()

    def _reserve(self, name: str, slots: int) -> None:
        texel = SLOT_TEXELS[name]
        size = slots * texel_bytes(texel)
        held = self._images.get(name)
        if held is not None and held.size_bytes >= size:
            return
        if held is not None:
            self._images.pop(name).release()
        tally(POOLS)
        image = BufferImage(self._ctx, slots, texel)
        self._images[name] = with_room(self._ctx, image, "slots of fragments", size, REMEDY)


def image_names(*, lit: bool) -> list[str]:
    """The images that a picture needs."""
    return ["slots", "slot_normals"] if lit else ["slots"]


def crossing_bytes(*, lit: bool) -> int:
    """What a slot takes."""
    return sum(texel_bytes(SLOT_TEXELS[name]) for name in image_names(lit=lit))


def slot_total(tile: Tile, groups: int) -> int:
    """How many slots groups of them for every pixel of a tile are."""
    constants = shared_constants()
    return groups * constants["SLOT_GROUP"] * packet_total(tile) * constants["PACKET_PIXELS"]


def packet_total(tile: Tile) -> int:
    """Packets of a tile."""
    constants = shared_constants()
    return _packets(tile.width, constants["PACKET_WIDTH"]) * _packets(tile.height, constants["PACKET_HEIGHT"])


def _packets(pixels: int, edge: int) -> int:
    return -(-pixels // edge)
