"""Pre-integration tables agree with quadrature of every entry, and take O(n²) operations."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from isosample.errors import CapacityError, InputError
from isosample.integral.quadrature import panel_nodes
from isosample.transfer.preintegration import length_table, length_tables, value_integrals
from isosample.transfer.table_sizes import LARGEST_TABLE_BYTES, LAYERS, check_table, layer_lengths
from isosample.transfer.transfer_function import ControlPoint, Isosurface, TransferFunction
from isosample.transfer.value_bands import ValueBands

F64 = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SIZE, LENGTH = 33, 0.7
# Step, thin tent (narrower than a bin), isosurfaces between nodes and on one (16 / 32), plateau.
SCENE = TransferFunction(
    [
        ControlPoint(0.05, (1, 0, 0), 0.0),
        ControlPoint(0.3, (1, 0.5, 0), 5.0),
        ControlPoint(0.45, (0, 0.5, 0), 1.0),
        ControlPoint(0.45, (0, 0, 1), 40.0),
        ControlPoint(0.7, (0, 1, 1), 0.0),
        ControlPoint(0.71, (0, 1, 1), 0.0),
        ControlPoint(0.7101, (1, 1, 1), 2000.0),
        ControlPoint(0.7102, (0, 1, 1), 0.0),
        ControlPoint(0.9, (1, 1, 0), 3.0),
        ControlPoint(1.0, (1, 0, 1), 3.0),
    ],
    [Isosurface(0.4, (1, 1, 1), 0.3), Isosurface(0.5, (1, 1, 0), 0.8)],
)


def straight_part(
    transfer_function: TransferFunction, values: tuple[float, float], start: float, end: float, length: float
) -> tuple[F64, float]:
    """Radiance and optical depth of a part of such a stretch, inside which the transfer function is linear."""
    nodes, weights = panel_nodes(np.linspace(start, end, 33), 8)
    color, extinction = transfer_function.evaluate(values[0] + nodes * (values[1] - values[0]))
    # The limit of the extinction at the start, then the depth up to a node in closed form.
    slope = (extinction[-1] - extinction[0]) / (nodes[-1] - nodes[0])
    limit = extinction[0] - slope * (nodes[0] - start)
    depth = length * (nodes - start) * 0.5 * (limit + extinction)
    return (weights * length * extinction * np.exp(-depth)) @ color, float(length * (weights @ extinction))


def straight(transfer_function: TransferFunction, front: float, back: float, length: float) -> F64:
    """Radiance and opacity (4,) of a stretch along which the value runs linearly, by Gauss-Legendre panels."""
    surfaces = {surface.value: surface for surface in transfer_function.isosurfaces}
    values = {*surfaces, *(point.value for point in transfer_function.points)}
    crossed = sorted(value for value in values if (front < value) != (back < value))
    crossed = crossed if back > front else crossed[::-1]
    places = [(value - front) / (back - front) for value in crossed]
    light, through = np.zeros(3), 1.0
    for i, (start, end) in enumerate(itertools.pairwise([0.0, *places, 1.0])):
        if end > start:
            radiance, depth = straight_part(transfer_function, (front, back), start, end, length)
            light, through = light + through * radiance, through * math.exp(-depth)
        if i < len(crossed) and crossed[i] in surfaces:
            surface = surfaces[crossed[i]]
            light = light + through * surface.opacity * np.array(surface.color)
            through *= 1.0 - surface.opacity
    return np.array([*light, 1.0 - through])


@pytest.fixture(scope="module")
def table() -> F64:
    """The scene's table."""
    return length_table(ValueBands.of(SCENE, 0.0, 1.0), SIZE, LENGTH).astype(np.float64)


def test_every_entry_is_the_integral_of_its_stretch(table: F64) -> None:
    nodes = np.linspace(0.0, 1.0, SIZE)
    expected = [[straight(SCENE, front, back, LENGTH) for front in nodes] for back in nodes]
    worst = np.abs(table - np.array(expected)).max()
    # 5e-7 of the quadrature, as the kernel says. Levels are rounded by 2^-25, but every band keeps its integral: only
    # places move by that. The last band, 0.1 wide, is 2^-23 wider (see ValueBands), 1.2e-6 of its extinction and of its
    # colours. Storage 2^-25.
    assert worst < 5e-7 + 2.0**-25 + 2.4e-6 + 2.0**-25


def test_the_colours_of_a_falling_stretch_come_in_the_other_order(table: F64) -> None:
    # The opaque blue side of the step is met first from above, last from below.
    low, high = round(0.2 * (SIZE - 1)), round(0.65 * (SIZE - 1))
    rising, falling = table[high, low], table[low, high]
    assert rising[3] == pytest.approx(falling[3], abs=1e-6)
    assert rising[2] < 0.8 * falling[2]


def test_an_isosurface_is_in_the_entries_that_cross_it_and_in_no_other() -> None:
    only = ValueBands.of(TransferFunction([], [Isosurface(0.5, (1, 0, 0), 0.25)]), 0.0, 1.0)
    found = length_table(only, 5, 1.0)[..., 3]
    nodes = np.linspace(0.0, 1.0, 5)
    crossed = (nodes[:, None] < 0.5) != (nodes[None, :] < 0.5)
    np.testing.assert_array_equal(found, np.where(crossed, np.float32(0.25), np.float32(0.0)))


def test_every_layer_is_the_table_of_its_length() -> None:
    bands = ValueBands.of(SCENE, 0.0, 1.0)
    lengths = layer_lengths(0.5)[::8]
    tables = length_tables(bands, 9, lengths)
    for layer, length in zip(tables, lengths, strict=True):
        np.testing.assert_array_equal(layer, length_table(bands, 9, float(length)))


def test_lengths_run_in_equal_ratios_from_a_64th_to_64_times_the_base() -> None:
    lengths = layer_lengths(3.0)
    assert len(lengths) == LAYERS
    assert (lengths[0], lengths[LAYERS // 2], lengths[-1]) == (3.0 / 64.0, 3.0, 192.0)
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], np.sqrt(2.0), rtol=1e-14)


def test_a_table_above_the_memory_limit_is_refused_and_the_next_size_named() -> None:
    with pytest.raises(
        CapacityError, match=r"1024 x 1024 values and 25 lengths takes 400 MiB.*--table-size 819"
    ):
        check_table(1024, LAYERS)
    check_table(819, LAYERS)
    assert 16 * 820**2 * LAYERS > LARGEST_TABLE_BYTES


@pytest.mark.parametrize(("size", "length"), [(1, 1.0), (4, 0.0), (4, np.inf)])
def test_tables_without_room_or_length_are_refused(size: int, length: float) -> None:
    with pytest.raises(InputError, match="expected two nodes, lengths above 0"):
        length_table(ValueBands.of(SCENE, 0.0, 1.0), size, length)


def test_integrals_over_the_value_are_those_of_every_cell() -> None:
    bands, cells = ValueBands.of(SCENE, 0.0, 1.0), 40
    found = value_integrals(bands, cells).astype(np.float64)
    cuts = np.unique(np.concatenate([np.linspace(0.0, 1.0, cells + 1), np.clip(bands.levels, 0.0, 1.0)]))
    nodes, weights = panel_nodes(cuts, 2)  # exact for the product of two straight lines
    optics = bands.evaluate(nodes)
    densities = optics[:, 3:] * np.concatenate([optics[:, :3], np.ones_like(optics[:, 3:])], axis=1)
    expected = np.zeros((cells, 4))
    np.add.at(expected, (nodes * cells).astype(int), weights[:, None] * densities)
    before = np.cumsum(expected, axis=0) - expected
    # Both are sums in float64, 1e-14; storage rounds by 2^-24 of the number.
    np.testing.assert_allclose(found[2], cells * expected, rtol=2.0**-24 + 1e-12, atol=1e-12)
    np.testing.assert_allclose(found[0], before, rtol=2.0**-24 + 1e-12, atol=1e-12)
    np.testing.assert_allclose(found[0] + found[1], before, rtol=2.0**-48, atol=1e-12)


@pytest.mark.parametrize("width", [0.02, 1e-9])
def test_a_tent_is_in_integrals_and_tables_however_narrow(width: float) -> None:
    area = 0.75
    tent = [(0.9, 0.0), (0.9 + width / 2, 2.0 * area / width), (0.9 + width, 0.0)]
    points = [ControlPoint(value, (1.0, 0.0, 0.0), extinction) for value, extinction in (*tent, (1.5, 0.0))]
    bands = ValueBands.of(TransferFunction(points), 0.0, 1.0)
    cells = 40
    found = value_integrals(bands, cells).astype(np.float64)
    # storage rounds by 2^-24, and the area is known as well as a width of 1e-9 in float64 at 0.9: 2^-53 / 1e-9 = 1.1e-7
    assert found[0, -1, 3] + found[2, -1, 3] / cells == pytest.approx(area, rel=1e-6)
    table = length_table(bands, 5, 2.0)
    assert table[4, 0, 3] == pytest.approx(-np.expm1(-2.0 * area), rel=1e-6)


def test_integrals_over_no_cell_are_refused() -> None:
    with pytest.raises(InputError, match="0 cells; expected at least 1"):
        value_integrals(ValueBands.of(SCENE, 0.0, 1.0), 0)
