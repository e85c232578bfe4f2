"""The pictures of the papers' figures, read from the drawing itself."""

import functools

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.patches import Polygon
from shapely import LineString, Point
from shapely import Polygon as Shape

import atlas_paper
import nadia_paper
from nadia_balance.core.body.reachability import (
    BACKWARD,
    BASE,
    FORWARD,
    cross_over_region,
    step_regions,
)
from nadia_balance.core.math.lipm import icp_after
from tests.example_walks import OMEGA
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


def line(ax, label):
    """The points (n, 2) of the one line of this label."""
    (found,) = [line for line in ax.lines if line.get_label() == label]
    return found.get_xydata()


def dot(ax, label):
    return line(ax, label)[0]


@functools.cache
def axes_of(number, paper=nadia_paper):
    """What that figure of a paper is drawn on; do not change it."""
    return paper.FIGURES[number]().axes


atlas_axes = functools.partial(axes_of, paper=atlas_paper)


def test_draws_the_figures_that_it_is_told(tmp_path, capsys):
    """Oracle: pictures with more than one colour, where it says."""
    argv = ["--figure", "5", "4", "--out", tmp_path]
    outcome = run_script(atlas_paper, argv, capsys)
    files = [
        tmp_path / f"atlas_figure_{number}.{ending}"
        for number in "45"
        for ending in ("png", "svg")
    ]
    assert outcome.code == 0
    assert outcome.out == [f"wrote {file}" for file in files]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    for file in files[::2]:
        pixels = np.rint(255 * imread(file)[:, :, :3]).astype(int)
        assert len(np.unique(pixels @ [1 << 16, 1 << 8, 1])) > 100
    assert_refused(run_script(atlas_paper, argv, capsys), "out = ")


def test_figure_3_is_nearest_without_and_parallel_with_the_cost():
    """Oracle: projection on the rectangle; the direction of the error.

    The weights leave 0.3 % of the feedback to the effort.
    """
    without, with_it = axes_of("3")
    limit = polygon(without, "limit of the CoP")
    low, high = np.array(limit.bounds).reshape(2, 2)
    asked = nadia_paper.COP_R + 3.0 * nadia_paper.ERROR
    assert dot(without, "eCMP asked for") == pytest.approx(asked)
    nearest = np.clip(asked, low, high)
    assert dot(without, "eCMP") == pytest.approx(nearest, abs=1e-3)
    way = dot(with_it, "eCMP") - nadia_paper.COP_R
    across = way[0] * nadia_paper.ERROR[1] - way[1] * nadia_paper.ERROR[0]
    assert abs(across) < 1e-2 * np.linalg.norm(way) * 0.065
    assert limit.exterior.distance(Point(dot(with_it, "eCMP"))) < 1e-6


def test_figure_4_nests_the_regions():
    """Oracle: containment, by shapely."""
    for ax in axes_of("4"):
        one, two, three = (polygon(ax, name) for name in nadia_paper.NAMES)
        assert two.buffer(1e-9).contains(one)
        assert three.buffer(1e-9).contains(two)
        assert one.area < two.area < three.area


def test_figure_4_shows_where_crossing_matters():
    """Oracle: shapely: only with crossed legs a step in reach recovers."""
    areas = []
    for ax in axes_of("4"):
        shared = polygons(ax, "in reach, and recovers")
        region = polygon(ax, "C₃").buffer(1e-9)
        reaches = polygons(ax, "in reach of the right foot")
        expected = sum((reach & region).area for reach in reaches)
        areas.append(sum(part.area for part in shared))
        assert areas[-1] == pytest.approx(expected, abs=1e-6)
    anywhere, side_by_side, crossed = areas
    assert side_by_side == 0.0
    assert 0.01 < crossed < anywhere


def test_figure_6_sweeps_the_very_regions_of_figure_4():
    """Oracle: shapely's hull of all swept copies, and Fig. 4."""
    for ax, of_figure_4 in zip(axes_of("6"), axes_of("4")[:2], strict=True):
        thin = (one for one in ax.patches if one.get_linewidth() == 0.6)
        swept = [Shape(patch.get_xy()) for patch in thin]
        assert len(swept) == 2 * 28
        for n, copies in (2, swept[:28]), (3, swept[28:]):
            region = polygon(of_figure_4, nadia_paper.NAMES[n - 1])
            drawn = polygon(ax, f"C{'₂₃'[n - 2]}: C₁ swept by -D{'₂₃'[n - 2]}")
            assert drawn.symmetric_difference(region).area < 1e-9
            for copy in copies:
                assert region.buffer(1e-9).contains(copy)
                assert region.exterior.distance(copy.exterior) < 1e-9


def test_figure_8_shows_the_regions_and_how_far_they_go():
    """Oracle: the polygons of the core, mirrored by hand."""
    together, *alone = axes_of("8")
    expected = step_regions(nadia_paper.REACH, cross_over=True)
    assert len(polygons(together, "reachable")) == 3
    for ax, name in zip(alone, (BASE, FORWARD, BACKWARD), strict=True):
        mirrored = Shape(expected[name] * [1.0, -1.0])
        drawn = polygon(ax, "reachable")
        assert drawn.symmetric_difference(mirrored).area < 1e-12
    written = [t.get_text() for ax in alone for t in ax.texts]
    tip = cross_over_region(nadia_paper.REACH, FORWARD)
    tip = tip[np.argmin(tip[:, 1])]
    for figure in (f"{-tip[1]:.2f} m", f"{tip[0]:.2f} m", "-0.05 m", "0.15 m"):
        assert any(text.endswith(f"= {figure}") for text in written)


def test_figure_9_obeys_the_three_rules():
    """Oracle: the rules, by the areas that shapely finds."""
    mirror = [1.0, -1.0]
    reach = {
        name: Shape(region * mirror)
        for name, region in step_regions(
            nadia_paper.REACH, cross_over=True
        ).items()
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
    (ax,) = atlas_axes("4")
    ends = [dot(ax, label) for label in ("reference, $ξ_r$", "its end, $ξ_t$")]
    way, icp = LineString(ends), Point(dot(ax, "ICP, $ξ$"))
    nearest = way.interpolate(way.project(icp))
    found = dot(ax, "projected ICP, $ξ_p$")
    assert found == pytest.approx([nearest.x, nearest.y], abs=1e-9)
    plan = LineString(line(ax, "ICP plan"))
    sped_up = Point(dot(ax, "sped-up reference"))
    assert plan.distance(sped_up) < 1e-4
    assert sped_up.distance(nearest) < 0.02


def test_the_atlas_papers_figure_5_helps_against_errors_along_the_way():
    """Oracle: Sec. III: little is left of a forward error, the least of it in
    fast steps; an error to the side is only marginally reduced.
    """
    left = []
    for ax in atlas_axes("5"):
        error = dot(ax, "ICP, $ξ$") - dot(ax, "reference, $ξ_r$")
        rest = dot(ax, "ICP, $ξ$") - dot(ax, "sped-up reference")
        left.append(np.linalg.norm(rest) / np.linalg.norm(error))
    slow, fast, aside = left
    assert fast < slow < 0.6
    assert 0.85 < aside < 1.0


def test_the_atlas_papers_figure_2_rounds_the_corners():
    """Oracle: Eq. 3, straight away from a CMP that rests; the same CMPs."""
    jumps, smooth = atlas_axes("2")
    cmps, knots = line(jumps, "CMPs of heel and toe"), line(jumps, "knots")
    for cmp, begin, end in zip(cmps, knots, knots[1:], strict=False):
        a, b = begin - cmp, end - cmp
        assert a[0] * b[1] - a[1] * b[0] == pytest.approx(0.0, abs=1e-9)
    assert np.array_equal(cmps, line(smooth, "CMPs of heel and toe"))


def test_the_atlas_papers_figure_3_is_farther_from_the_foot_the_faster():
    """Oracle: the distances from the stance sole's centre at mid-swing."""
    away = []
    for ax in atlas_axes("3"):
        x, y = dot(ax, "half-way through a swing")
        away.append(np.hypot(x, y - 0.125))
    assert away[0] < away[1] < away[2]


@pytest.mark.parametrize("advance", [0.0, 0.1, 0.7])
def test_finds_the_time_by_which_the_icp_was_advanced(advance, aside=-0.2):
    """Oracle: move the ICP along Eq. 3 by a known time, ask for it back.

    A displacement at right angles to the way does not count (Eq. 15).
    """
    ecmp, icp_r = np.array([0.3, 0.7]), np.array([0.5, 1.0])
    end = icp_after(icp_r, ecmp, OMEGA, 0.7)
    normal = np.array([ecmp[1] - end[1], end[0] - ecmp[0]])
    icp = icp_after(icp_r, ecmp, OMEGA, advance) + aside * normal
    done = atlas_paper.fraction_done(icp, icp_r, end)
    found = atlas_paper.time_ahead(done, 0.7, OMEGA)
    assert found == pytest.approx(advance, abs=1e-12)
