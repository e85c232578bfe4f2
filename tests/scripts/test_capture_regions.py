"""The pictures of the papers' figures, read from the drawing itself."""

import functools

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.patches import Polygon
from shapely import LineString, MultiPoint, Point
from shapely import Polygon as Shape

from nadia_balance.core.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    cross_over_region,
    step_regions,
)
from nadia_balance.results.plots import capture_regions as regions
from nadia_balance.scripts import capture_regions
from nadia_balance.scripts.capture_regions import FIGURES
from tests.scripts.running import assert_refused, run_script


def polygons(ax, label):
    """The polygons of this label, as shapes."""
    return [
        Shape(patch.get_xy())
        for patch in ax.patches
        if isinstance(patch, Polygon) and patch.get_label() == label
    ]


def polygon(ax, label):
    (found,) = polygons(ax, label)
    return found


def dot(ax, label):
    (line,) = [line for line in ax.lines if line.get_label() == label]
    return np.array([line.get_xdata()[0], line.get_ydata()[0]])


@functools.cache
def axes_of(number):
    """What that figure is drawn on; do not change it."""
    return FIGURES[number]().axes


@pytest.mark.parametrize("flags", [["--figure", "4", "atlas_5"], []])
def test_draws_the_figures_that_it_is_told_or_all(tmp_path, capsys, flags):
    """Oracle: pictures with more than one colour, where it says."""
    argv = [*flags, "--out", tmp_path]
    outcome = run_script(capture_regions, argv, capsys)
    names = [f"figure_{n}.png" for n in flags[1:] or FIGURES]
    assert outcome.code == 0
    assert outcome.out == [f"wrote {tmp_path / name}" for name in names]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    for name in names:
        pixels = np.rint(255 * imread(tmp_path / name)[:, :, :3]).astype(int)
        assert pixels.size > 1_500_000
        assert len(np.unique(pixels @ [1 << 16, 1 << 8, 1])) > 100


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--figure", "5"], "argument --figure: invalid choice: '5'"),
        (["--out", "/dev/null/x"], "out = '/dev/null/x': must be a folder"),
    ],
)
def test_says_what_is_wrong_on_one_line(argv, message, capsys):
    assert_refused(run_script(capture_regions, argv, capsys), message)


def test_figure_3_is_nearest_without_and_parallel_with_the_cost():
    """Oracle: projection on the rectangle; the direction of the error.

    The weights leave 0.3 % of the feedback to the effort.
    """
    without, with_it = axes_of("3")
    limit = polygon(without, "limit of the CoP")
    low, high = np.array(limit.bounds).reshape(2, 2)
    asked = regions.COP_R + 3.0 * regions.ERROR
    assert dot(without, "eCMP asked for") == pytest.approx(asked)
    nearest = np.clip(asked, low, high)
    assert dot(without, "eCMP") == pytest.approx(nearest, abs=1e-3)
    way = dot(with_it, "eCMP") - regions.COP_R
    across = way[0] * regions.ERROR[1] - way[1] * regions.ERROR[0]
    assert abs(across) < 1e-2 * np.linalg.norm(way) * 0.065
    assert limit.exterior.distance(
        MultiPoint([dot(with_it, "eCMP")])
    ) == pytest.approx(0.0, abs=1e-6)


def test_figure_4_nests_the_regions():
    """Oracle: containment, by shapely."""
    for ax in axes_of("4"):
        one, two, three = (polygon(ax, name) for name in regions.NAMES)
        assert two.buffer(1e-9).contains(one)
        assert three.buffer(1e-9).contains(two)
        assert one.area < two.area < three.area


def test_figure_4_shows_what_crossing_over_gains():
    """Oracle: the paper's text on Fig. 4; the scaled reach, by hand.

    Inward, that is to the left: w_min forbids the next step any correction,
    crossing over allows w_fwd, the circle all of l_max.
    """
    contraction = np.exp(-regions.MODEL.omega * regions.STEP_DURATION)
    gains = []
    for ax in axes_of("4"):
        tops = [polygon(ax, name).bounds[3] for name in regions.NAMES[:2]]
        gains.append(tops[1] - tops[0])
    assert gains == pytest.approx(contraction * np.array([1.0, 0.0, 0.1]))


def test_figure_6_sweeps_the_very_regions_of_figure_4():
    """Oracle: shapely's hull of all swept copies, and Fig. 4."""
    for ax, of_figure_4 in zip(axes_of("6"), axes_of("4")[:2], strict=True):
        swept = [
            Shape(patch.get_xy())
            for patch in ax.patches
            if patch.get_linewidth() == 0.6
        ]
        assert len(swept) == 2 * 28
        for n, copies in (2, swept[:28]), (3, swept[28:]):
            region = polygon(of_figure_4, regions.NAMES[n - 1])
            label = "C₂: C₁ swept by -D₂" if n == 2 else "C₃: C₁ swept by -D₃"
            assert polygon(ax, label).symmetric_difference(
                region
            ).area == pytest.approx(0.0, abs=1e-9)
            for copy in copies:
                assert region.buffer(1e-9).contains(copy)
                assert region.exterior.distance(copy.exterior) < 1e-9


def test_figure_8_shows_the_regions_and_how_far_they_go():
    """Oracle: the polygons of the core, mirrored by hand."""
    together, *alone = axes_of("8")
    expected = step_regions(regions.REACH, cross_over=True)
    assert len(polygons(together, "reachable")) == 3
    for ax, name in zip(alone, (BASE, FORWARD, BACKWARD), strict=True):
        mirrored = Shape(expected[name] * [1.0, -1.0])
        drawn = polygon(ax, "reachable")
        assert drawn.symmetric_difference(mirrored).area < 1e-12
    written = [t.get_text() for ax in alone for t in ax.texts]
    tip = cross_over_region(regions.REACH, FORWARD)
    tip = tip[np.argmin(tip[:, 1])]
    for figure in (f"{-tip[1]:.2f} m", f"{tip[0]:.2f} m", "-0.05 m", "0.125 m"):
        assert any(text.endswith(f"= {figure}") for text in written)


def test_figure_9_obeys_the_three_rules():
    """Oracle: the rules, by the areas that shapely finds."""
    mirror = [1.0, -1.0]
    reach = {
        name: Shape(region * mirror)
        for name, region in step_regions(regions.REACH, cross_over=True).items()
    }
    for rule, ax in enumerate(axes_of("9"), start=1):
        capture = polygon(ax, "capture region C₃")
        chosen = polygon(ax, "reachable")
        (name,) = [n for n, r in reach.items() if r.equals(chosen)]
        shared = {n: r.intersection(capture).area for n, r in reach.items()}
        if rule == 1:
            assert name == BASE
            assert shared[BASE] > 0.0
        elif rule == 2:
            assert name == max(shared, key=shared.get) != BASE
        else:
            assert set(shared.values()) == {0.0}
            gaps = {n: r.distance(capture) for n, r in reach.items()}
            assert name == min(gaps, key=gaps.get)
        foothold = polygon(ax, "adjusted foothold")
        assert chosen.buffer(1e-6).contains(foothold.centroid)
        assert foothold.intersection(polygon(ax, "left foot")).area < 1e-9


def test_the_atlas_papers_figure_4_projects_the_icp():
    """Oracle: shapely; the sped-up reference is on the plan, and near it."""
    (ax,) = FIGURES["atlas_4"]().axes
    ends = [dot(ax, label) for label in ("reference, $ξ_r$", "its end, $ξ_t$")]
    way, icp = LineString(ends), Point(dot(ax, "ICP, $ξ$"))
    nearest = way.interpolate(way.project(icp))
    found = dot(ax, "projected ICP, $ξ_p$")
    assert found == pytest.approx([nearest.x, nearest.y], abs=1e-9)
    (plan,) = [line for line in ax.lines if line.get_label() == "ICP plan"]
    sped_up = Point(dot(ax, "sped-up reference"))
    assert LineString(plan.get_xydata()).distance(sped_up) < 1e-4
    assert sped_up.distance(nearest) < 0.02


def test_the_atlas_papers_figure_5_helps_against_errors_along_the_way():
    """Oracle: Sec. III: little is left of a forward error, the least of it in
    fast steps; an error to the side is only marginally reduced.
    """
    left = []
    for ax in FIGURES["atlas_5"]().axes:
        error = dot(ax, "ICP, $ξ$") - dot(ax, "reference, $ξ_r$")
        rest = dot(ax, "ICP, $ξ$") - dot(ax, "sped-up reference")
        left.append(np.linalg.norm(rest) / np.linalg.norm(error))
    slow, fast, aside = left
    assert fast < slow < 0.6
    assert 0.85 < aside < 1.0


def test_the_atlas_papers_figure_2_rounds_the_corners():
    """Oracle: Eq. 3, straight away from a CMP that rests; the same CMPs."""
    jumps, smooth = FIGURES["atlas_2"]().axes
    cmps, knots = (
        [line.get_xydata() for line in jumps.lines if line.get_label() == label]
        for label in ("CMPs of heel and toe", "knots")
    )
    (cmps,), (knots,) = cmps, knots
    for cmp, begin, end in zip(cmps, knots, knots[1:], strict=False):
        a, b = begin - cmp, end - cmp
        assert a[0] * b[1] - a[1] * b[0] == pytest.approx(0.0, abs=1e-9)
    (same,) = [
        line.get_xydata()
        for line in smooth.lines
        if line.get_label() == "CMPs of heel and toe"
    ]
    assert np.array_equal(cmps, same)


def test_the_atlas_papers_figure_3_is_farther_from_the_foot_the_faster():
    """Oracle: the distances from the stance sole's centre at mid-swing."""
    away = []
    for ax in FIGURES["atlas_3"]().axes:
        x, y = dot(ax, "half-way through a swing")
        away.append(np.hypot(x, y - 0.125))
    assert away[0] < away[1] < away[2]
