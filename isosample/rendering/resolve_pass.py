"""The resolve pass: programs that sort and integrate the lists of a tile, each taking what the ones before left.

Source: Lindholm et al., "Towards data centric sampling for volume rendering", Algorithm 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from isosample.errors import CapacityError
from isosample.integral.segment_rule import SegmentRule
from isosample.rendering.frame import shared_constants
from isosample.rendering.settings import ResolveStage
from isosample.rendering.slot_resolve import SlotResolve
from isosample.rendering.stage import resolve_stage, work_groups
from isosample.rendering.supplies import merge_supply, resolve_supply

if TYPE_CHECKING:
    from isosample.rendering.pass_resources import PassResources
    from isosample.rendering.picture_frame import PictureFrame
    from isosample.rendering.picture_target import PictureTarget
    from isosample.rendering.tiles import Tile

SEGMENT_RULES = {
    SegmentRule.CONSTANT: 0,
    SegmentRule.CONSTANT_FIRST_ORDER: 1,
    SegmentRule.LINEAR: 2,
    SegmentRule.CUBIC: 3,
}
# Classes of lists by length, in runs of 16 nodes; 0: empty. Each takes one program, which resolves the chains among
# the lists that the one before left; see shaders/pass/chain.glsl. More classes take longer: every program loads in
# vain what it leaves.
RUN = 16
CHAIN_CLASSES = (0, 6, 16)
BALANCED_RUNS = 6  # of lists that are no chains, but whose crossings add up; see shaders/pass/balanced.glsl
# Nodes of other lists that are sorted in an array: longer ones are sorted on their links, which takes no longer.
LARGEST_ARRAY = 16
BROKEN = 1
TAKEN = {"resolve_chain": 0, "resolve_balanced": BROKEN, "resolve": 2}  # see shaders/open_blocks.vert
LONGEST_LIST = 7_000  # up to 9 loop iterations per node in one shader call stay below llvmpipe's 65535


class ResolvePass:
    """Resolves lists into a picture.

    Parameters
    ----------
    shared : PassResources
    target : PictureTarget
    """

    def __init__(self, shared: PassResources, target: PictureTarget) -> None:
        self._shared = shared
        self._target = target
        self._slots = SlotResolve(shared, target)

    def resolve(self, tile: Tile, frame: PictureFrame) -> bool:
        """Sort and integrate the lists of a tile into the target; False if too many that are in slots are no chains."""
        with self._shared.timer.stage("resolve"):
            if frame.in_slots:
                return self._resolve_slots(tile, frame)
            chains = not self._shared.scene.has_mask and frame.settings.sort_capacity >= RUN
            if not chains or self._resolve_chains(tile, frame):
                self._resolve_rest(tile, frame, first=not chains)
            return True

    def _resolve_slots(self, tile: Tile, frame: PictureFrame) -> bool:
        """Resolve the lists in slots; False if there is no room for those that are no chains."""
        left = self._slots.resolve(tile, frame, self._constants(frame))
        if left:
            self._resolve_rest(tile, frame, first=False)
        return left is not None

    def _resolve_chains(self, tile: Tile, frame: PictureFrame) -> bool:
        """Resolve the lists that are chains, by classes of length; return whether any list is left."""
        counters, longer = self._shared.pool.counters(), True
        for number, runs in enumerate(CHAIN_CLASSES):
            if RUN * runs > frame.settings.sort_capacity:
                break
            before = int(counters["longer_lists"])
            self._run_resolve(
                "resolve_chain",
                tile,
                frame,
                first=number == 0,
                RUN=RUN,
                RUNS=runs,
                FACE_BAND=self._shared.scene.face_band,
            )
            counters = self._shared.pool.counters()
            longer = int(counters["longer_lists"]) > before
            if not longer:
                break
        return self._resolve_balanced(tile, frame, int(counters["broken_chains"])) > 0 or longer

    def _resolve_balanced(self, tile: Tile, frame: PictureFrame, broken: int) -> int:
        """Resolve those of the lists that are no chains which add up; return how many such lists are left."""
        if broken == 0 or frame.settings.sort_capacity < RUN * BALANCED_RUNS:
            return broken
        self._run_resolve("resolve_balanced", tile, frame, first=False, RUN=RUN, RUNS=BALANCED_RUNS)
        return broken - int(self._shared.pool.counters()["balanced_lists"])

    def _resolve_rest(self, tile: Tile, frame: PictureFrame, *, first: bool) -> None:
        """Resolve all lists that are left; very long ones take a second round."""
        constants = shared_constants()
        capacity = min(frame.settings.sort_capacity, LARGEST_ARRAY)
        self._run_resolve("resolve", tile, frame, first=first, SORT_CAPACITY=capacity)
        longest = int(self._shared.pool.counters()["max_depth_complexity"])
        if longest > constants["LINK_SORT_LIMIT"]:
            self._merge_long_lists(tile, longest)
            frame.block["longest_walked"] = LONGEST_LIST
            self._shared.bind(tile, frame)
            self._run_resolve("resolve", tile, frame, first=False, SORT_CAPACITY=capacity)
            frame.block["longest_walked"] = constants["LINK_SORT_LIMIT"]

    def _run_resolve(
        self, entry: str, tile: Tile, frame: PictureFrame, *, first: bool, **constants: int
    ) -> None:
        """Run one program of the resolve pass over a tile: the first one, or one that finds something done."""
        constants |= self._constants(frame)
        stage = resolve_stage(self._shared.ctx, frame.settings.stage)
        supply = resolve_supply(compute=stage is ResolveStage.COMPUTE)
        if stage is ResolveStage.FRAGMENT:
            screen = "screen.vert" if first else "open_blocks.vert"
            takes = {} if first else {"TAKES": self._taken(entry, frame)}
            program = self._shared.programs.graphics(screen, f"{entry}.frag", supply, **takes, **constants)
            if first:
                self._target.fill(tile, program)
            else:
                self._target.fill_blocks(tile, program, shared_constants()["RESOLVE_BLOCK"])
        else:
            self._target.fill(tile, self._shared.programs.compute(f"{entry}.comp", supply, **constants))
        self._shared.ctx.memory_barrier()

    def _taken(self, entry: str, frame: PictureFrame) -> int:
        """Which lists the last of the programs takes, for open_blocks.vert."""
        seen = self._shared.scene.face_band < 0  # else empty lists in slots need no program
        return BROKEN if frame.in_slots and not seen else TAKEN[entry]

    def _constants(self, frame: PictureFrame) -> dict[str, int]:
        """Of every program of the pass."""
        rule = SEGMENT_RULES[frame.settings.segment]
        return self._shared.scene.constants | {"SHADING": frame.shading, "SEGMENT_RULE": rule}

    def _merge_long_lists(self, tile: Tile, longest: int) -> None:
        """Sort the lists above LINK_SORT_LIMIT, one merge pass per call."""
        if longest > LONGEST_LIST:
            raise CapacityError(
                f"one pixel has {longest} fragments; at most {LONGEST_LIST} can be sorted. "
                "Use fewer isovalues."
            )
        program = self._shared.programs.compute("merge_lists.comp", merge_supply(), SORT_CAPACITY=1)
        run = 1
        while run < longest:
            program["run"] = run
            program.run(*work_groups(tile))
            self._shared.ctx.memory_barrier()
            run *= 2
