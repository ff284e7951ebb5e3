"""The resolve pass of lists in slots: chains, by packets of pixels; the other lists become linked ones first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.errors import CapacityError
from isosample.rendering.crossing_slots import CLASSES
from isosample.rendering.fragment_pool import NODE_STEP, step_bytes
from isosample.rendering.frame import shared_constants
from isosample.rendering.stage import line_groups, run_interleaved
from isosample.rendering.supplies import listed_supply, slot_supply, spill_supply

if TYPE_CHECKING:
    from collections.abc import Sequence

    from isosample.rendering.pass_resources import PassResources
    from isosample.rendering.picture_frame import PictureFrame
    from isosample.rendering.picture_target import PictureTarget
    from isosample.rendering.tiles import Tile

ENTRY = "resolve_slots.comp"
FEW = 1 / 16  # of all packets with crossings
LEAST_NODES = 1 << 14  # of the pool, so that it does not grow by a few nodes from picture to picture


def takers(counts: Sequence[int], ready: Sequence[bool]) -> list[int]:
    """Which program takes the packets of each class.

    Parameters
    ----------
    counts : sequence of int
        Packets of every class.
    ready : sequence of bool
        Whether the program of a class is compiled already.

    Returns
    -------
    takers : list of int
        The class itself; or, for a few packets whose program is not there yet, the next larger one that is there or
        needed anyway. Programs take up to a second to compile, on the first run on a machine.
    """
    few = FEW * sum(counts[1:])
    found = list(range(len(counts)))
    there = list(ready)
    for own in range(len(counts) - 1, 0, -1):
        larger = [other for other in range(own + 1, len(counts)) if there[other]]
        if counts[own] and not there[own] and counts[own] < few and larger:
            found[own] = larger[0]
        there[own] = there[own] or (counts[own] > 0 and found[own] == own)
    return found


class SlotResolve:
    """Resolves lists in slots into a picture: chains, and those whose crossings add up.

    Parameters
    ----------
    shared : PassResources
    target : PictureTarget
    """

    def __init__(self, shared: PassResources, target: PictureTarget) -> None:
        self._shared = shared
        self._target = target

    def resolve(self, tile: Tile, frame: PictureFrame, constants: dict[str, int]) -> int | None:
        """Resolve the lists of a tile that are chains or balanced.

        Parameters
        ----------
        tile : Tile
        frame : PictureFrame
        constants : dict
            Of every program of the resolve pass.

        Returns
        -------
        left : int or None
            How many others there are, now linked ones; None if there is no room for these.
        """
        shared = self._shared
        band = shared.scene.face_band
        if band >= 0:  # where a list is empty nothing is seen
            self._target.clear(frame.block[0]["background"], tile)
        shared.slots.bind()
        self._target.bind()
        packet_pixels = shared_constants()["PACKET_PIXELS"]
        packets = shared.slots.packets()
        variants = [{"RUN": run, "RUNS": runs, "FACE_BAND": band, **constants} for run, runs in CLASSES]
        if shared.scene.faces_seen:  # of an empty list something may be seen
            variants[0] = variants[1]
        ready = [shared.programs.has_compute(ENTRY, **variant) for variant in variants]
        for place, ((first, count), taker) in enumerate(
            zip(packets, takers([count for _, count in packets], ready), strict=True)
        ):
            if count == 0 or (place == 0 and band >= 0):
                continue
            program = shared.programs.compute(ENTRY, slot_supply(), **variants[taker])
            program["first_packet"], program["packet_number"] = first, count
            run_interleaved(shared.ctx, program, line_groups(count * packet_pixels))
        shared.ctx.memory_barrier()
        counters = shared.pool.counters()
        broken = int(counters["broken_chains"])
        if broken == 0:
            return 0
        if not self._spill(tile, frame, broken, int(counters["broken_nodes"])):
            return None
        run, runs = CLASSES[-1]
        variant = {"RUN": run, "RUNS": runs, **constants}
        program = shared.programs.compute("resolve_listed.comp", listed_supply(), **variant)
        run_interleaved(shared.ctx, program, line_groups(broken))
        shared.ctx.memory_barrier()
        return broken - int(shared.pool.counters()["balanced_lists"])

    def _spill(self, tile: Tile, frame: PictureFrame, lists: int, nodes: int) -> bool:
        """Make linked lists of those that are no chains, if they fit what the slots have left of the budget."""
        shared = self._shared
        budget = frame.settings.fragment_budget_bytes - shared.slots.size_bytes
        wanted = max(nodes, min(LEAST_NODES, budget // step_bytes() * NODE_STEP))
        try:
            if not shared.pool.grow(wanted, budget):
                return False
        except CapacityError:  # of the driver: linked lists have the slots' room, too
            return False
        shared.bind(tile, frame)
        constants = {"SHADING": frame.shading, **shared.pool.constants}
        program = shared.programs.compute("spill_slots.comp", spill_supply(), **constants)
        program.run(line_groups(lists))
        shared.ctx.memory_barrier()
        return True
