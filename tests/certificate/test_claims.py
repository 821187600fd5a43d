"""Claims: the independent check derives the same numbers; bounds of contacts and margins by hand; refusals."""

import copy
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmopt import plan
from fmopt.certificate.assembly import contact_rows
from fmopt.certificate.claim import claimed, facet_rows, stepped
from fmopt.certificate.error_set import ErrorSet
from fmopt.certificate.facet_margin import UNBOUNDED, bounds
from fmopt.certificate.piece_pairs import PlaneWitness, facing, free_plane
from fmopt.certificate.remainder import EndsBatch
from fmopt.certificate.separating_plane import counted_rows, row_bounds, separation
from fmopt.contact.primitive import face_vertex
from fmopt.errors import InfeasibleError
from fmopt.planning.moves.separating_planes import choose_separations
from fmopt.planning.plan_record import contact_record, part_record, segment_record
from fmopt.spatial.se3 import Pose
from fmopt.verify import CERTIFIED, NOT_PROVED, verify
from tests.shared.parts.peg_pieces import CLEAR, HALF, START_BOX, TOLERANCE, claims, moves, peg, settled

NO_STRATEGY = {
    "frame": [0.0] * 6,
    "position_axes": [],
    "force_axes": [],
    "velocity": [0.0] * 6,
    "speed": 2.0,
    "bias_wrench": [0.0] * 6,
    "push": 0.0,
    "stays": "push",
    "normal_forces": [],
    "termination": {"contacts": [], "wrench": [0.0] * 6, "threshold": 2.0, "max_travel": 0.0, "timeout": 0.0},
}
OF_CONTROL = {"velocity", "hybrid", "normal_forces", "frame", "speed"}
FORCES = ("speed", "contact_force", "torque_limit", "friction", "termination_force")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """A plan of the hand-made motion, with all that the check asks for but control strategies worth the name."""
    found, segments, move = claims(), [], -1
    for c in found:
        move += c.piece.progress[0] == 0.0
        segment = segment_record(c, move, c.piece.start.vector(), c.piece.goal.vector())
        segments.append({**segment, "hybrid": NO_STRATEGY})
    used = {k.id: k for c in found for k in c.piece.goal_contacts}
    body = {
        "format": plan.FORMAT,
        "fmopt_version": "1.0",
        "units": plan.UNITS,
        "frames": plan.FRAMES,
        "problem": {"title": "a square peg by hand", "sha256": "0" * 64},
        "verdict": CERTIFIED,
        "uncertainty": {"start_box": START_BOX, "velocity_error": TOLERANCE.velocity_error, "rho": TOLERANCE.rho},
        "specification": dict.fromkeys(FORCES, 1.0),
        "goal": found[-1].piece.goal.vector(),
        "touch_tolerance": 1e-9,
        "not_covered": list(plan.NOT_COVERED),
        "parts": {
            "moving": part_record(peg().assembly.moving, (1e-4, 1e-4), 1e-4),
            "fixed": part_record(peg().assembly.fixed, (1e-4, 1e-4), 1e-4),
        },
        "contacts": [contact_record(k) for k in used.values()],
        "segments": segments,
    }
    return plan.sealed(plan.clean(body))


def derived(document: dict[str, Any]) -> list[str]:
    """What the check finds wrong, apart from the control strategies, which do nothing."""
    found = [f for f in verify(document).findings if not f.what.startswith("termination.")]
    return [str(f) for f in found if f.what not in OF_CONTROL]


def test_the_check_derives_every_number_of_an_untouched_plan(document: dict[str, Any]) -> None:
    verdict = verify(document)
    assert derived(document) == []
    assert verdict.verdict == NOT_PROVED
    assert {f.segment for f in verdict.findings} == set(range(len(document["segments"])))
    assert verdict.margin == pytest.approx(min(c.margin for c in claims()), rel=1e-10)


def test_the_check_derives_the_error_sets_of_the_planner(document: dict[str, Any]) -> None:
    found = plan.parsed(document).error_sets
    ends = [claims()[0].advance.ends.start_set, *(c.advance.ends.goal_set for c in claims())]
    scale = np.repeat([1.0, TOLERANCE.rho], 3)
    for one, other in zip(found, ends, strict=True):
        np.testing.assert_allclose(one.generators * scale, other.generators * scale, rtol=1e-10, atol=1e-14)
        drifts = (root @ root.T for root in (other.slide_root, other.swing_root))
        for Q, P in zip((one.shape, one.slide, one.swing), (other.shape, *drifts), strict=True):
            radii = np.sqrt(np.diag(Q)) * scale + 3e-10
            np.testing.assert_array_less(np.abs(Q - P) * np.outer(scale, scale), 1e-9 * np.outer(radii, radii))


def _smaller(segment: dict[str, Any], *path: Any) -> None:
    *inner, last = path
    for key in inner:
        segment = segment[key]
    segment[last] *= 1.0 - 1e-6


@pytest.mark.parametrize(
    "path",
    [
        ("tube", "theta_max"),
        ("tube", "offset_box", 1),
        ("tube", "angle_box", 0),
        ("contacts", 0, "remainder"),
        ("separations", 3, "margin"),
        ("basis", -1, "direction", 4),
    ],
)
def test_the_check_rejects_a_number_that_is_off_by_a_millionth(document: dict[str, Any], path: tuple[Any, ...]) -> None:
    changed = copy.deepcopy(document)
    last = next(s for s in changed["segments"] if s["move"] == 2 and s["progress"][1] == 1.0)
    _smaller(last, *path)
    assert derived(plan.sealed(changed))


def test_the_margin_is_the_least_of_all() -> None:
    for c in claims():
        every = [s.margin for _, _, s in c.separations] + [k.margin for k in c.contacts]
        every += [] if c.early is None else [c.early]
        assert c.margin == min(every) > 0.0
        assert (c.early is not None) == (c.piece.made is not None and c.piece.progress[0] == 0.0)


def test_row_bounds_are_what_the_separation_is_made_of() -> None:
    c = next(c for c in claims() if c.piece.made is not None and c.piece.last)
    for (_, _, found), (_, _, pair) in zip(c.separations, facing(peg().assembly, c.piece).listed, strict=True):
        rows = row_bounds(peg().assembly, pair, found.witness, c.advance.ends)
        assert rows.lower.min() / rows.scale == pytest.approx(found.margin, rel=1e-12)
        again = separation(peg().assembly, pair, found.witness, c.advance.ends)
        assert again.clearance == pytest.approx(found.clearance, rel=1e-12)
        assert found.margin <= found.clearance


def test_facet_rows_are_what_the_contacts_margins_are_made_of() -> None:
    for c in claims():
        found: dict[str, list[float]] = {}
        for facet in facet_rows(peg().assembly, c):
            for contact, margin in zip(facet.contacts, facet.table.margins(facet.lower), strict=True):
                found.setdefault(contact.id, []).append(margin)
        assert {k.contact.id for k in c.contacts} == set(found)
        for k in c.contacts:
            assert k.margin <= min(found[k.contact.id]) + 1e-15


def test_margins_of_contacts_change_as_their_slopes_say() -> None:
    """Of 1 µm or 1 µrad against the slope, up to what the rows' curvature is."""
    seen = 0
    for c in claims():
        for facet in facet_rows(peg().assembly, c):
            pose = (c.advance.ends.start, c.advance.ends.goal)[facet.end]
            for contact, margin in enumerate(facet.table.margins(facet.lower)):
                slope = facet.table.slope(contact, facet.lower)
                if abs(margin) == UNBOUNDED:
                    continue
                assert slope.any()
                N = slope @ facet.rows.N
                shift = -1e-6 * N / float(np.linalg.norm(N))
                lower = facet.lower + facet.table.forms.at(pose.moved(shift)).f - facet.rows.f
                change = facet.table.margins(lower)[contact] - margin
                assert change == pytest.approx(float(N @ shift), abs=2e-8)
                seen += 1
    assert seen > 20


def test_the_chosen_plane_is_as_good_as_any_face() -> None:
    for c in claims()[::5]:
        listed = facing(peg().assembly, c.piece)
        chosen = choose_separations(peg().assembly, listed, EndsBatch.of([c.advance.ends]))[0]
        for (_, _, found), (_, _, pair), again in zip(c.separations, listed.listed, chosen, strict=True):
            assert again.margin == pytest.approx(found.margin, rel=1e-12)
            faces = [PlaneWitness("moving-face", face.loops[0], ()) for face in pair.moving.faces]
            if not pair.touched:
                faces += [free_plane(face.normal.tolist(), face.offset) for face in pair.fixed.faces]
            for face in faces:
                if len(counted_rows(peg().assembly, pair, face).forms):
                    other = separation(peg().assembly, pair, face, c.advance.ends)
                    assert other.clearance < 0.0 or other.margin <= found.margin + 1e-15


def test_contact_bounds_are_nominal_distances_without_errors() -> None:
    """With exact rows, the vertex keeps its distances to the convex rims, the edge those to its ends and sides."""
    way = moves()[3]
    held = tuple(peg().contacts[name] for name in ("left edge", "left corner"))
    table = bounds(peg().assembly, held, held)
    edge, corner = table.margins(table.forms.at(way.start).f)
    depth = -float(way.start.apply(peg().corner)[2])
    assert corner == pytest.approx(depth, rel=1e-9)
    assert 0.0 < edge <= depth + 1e-12


def test_a_rim_with_a_wall_behind_it_does_not_bound() -> None:
    seated = moves()[-1]
    table = bounds(peg().assembly, tuple(peg().contacts[f"floor {n}"] for n in range(4)), seated.after)
    # All rims of the floor are re-entrant: the walls keep the corners in, however near they are.
    assert table.margins(table.forms.at(seated.goal).f) == [UNBOUNDED] * 4
    assert table.margins(table.forms.at(seated.goal).f - 1e-3) == [UNBOUNDED] * 4


def test_a_vertex_and_an_edge_take_turns_at_a_rim() -> None:
    c = peg().contacts
    pair = (c["left corner"], c["other left corner"], c["leading edge"])
    table = bounds(peg().assembly, pair, pair)
    lower = np.ones(len(table.forms))
    # The other corner is above the rim, the leading one well below it.
    level = Pose(np.array([HALF - CLEAR, 0.0, 0.0]), np.eye(3))
    tilted = settled(level.moved([0, 0, -1e-3, 0.15, 0, 0]), [], np.zeros((0, 6)), [])
    first, second, edge = table.margins(table.forms.at(tilted).f)
    heights = [float(tilted.apply(peg().assembly.moving.polyhedron.vertices[k.moving[0]])[2]) for k in pair[:2]]
    assert heights[0] < 0.0 < heights[1]
    assert first > 0.0
    assert second == UNBOUNDED
    assert edge > 0.0
    alone = bounds(peg().assembly, pair[1:2], pair[1:2])
    assert alone.margins(alone.forms.at(tilted).f)[0] == pytest.approx(-heights[1], rel=1e-9)
    assert lower.all()


def test_a_fixed_vertex_keeps_its_distance_to_the_edges_of_the_moving_face() -> None:
    own, fixed = peg().assembly.moving.polyhedron, peg().assembly.fixed.polyhedron
    bottom = next(n for n, f in enumerate(own.faces) if f.normal[2] < -0.999)
    corner = int(np.argmin(np.linalg.norm(fixed.vertices - [0.03, 0.03, 0.0], axis=1)))
    contact = face_vertex(own, bottom, corner)
    table = bounds(peg().assembly, (contact,), (contact,))
    over = Pose(fixed.vertices[corner] - [0.004, -0.007, 0.0], np.eye(3))
    (margin,) = table.margins(table.forms.at(over).f)
    assert margin == pytest.approx(HALF - 0.007, abs=1e-12)
    assert contact_rows(peg().assembly, [contact], [contact], over).f[0] == pytest.approx(0.0, abs=1e-15)


def test_claims_survive_a_trip_to_another_process() -> None:
    assembly, one = pickle.loads(pickle.dumps((peg().assembly, claims()[4])))
    step = stepped(assembly, one.piece, one.advance.ends.start_set, TOLERANCE)
    (again,) = claimed(assembly, [(one.piece, step)], TOLERANCE, choose_separations)
    assert again.margin == claims()[4].margin


def test_pieces_that_overlap_nominally_are_refused() -> None:
    piece = claims()[0].piece
    low = replace(piece, start=piece.start.moved([0, 0, -0.02, 0, 0, 0]), goal=piece.goal.moved([0, 0, -0.02, 0, 0, 0]))
    step = stepped(peg().assembly, low, ErrorSet.from_box(START_BOX), TOLERANCE)
    with pytest.raises(InfeasibleError, match="not apart on the nominal path"):
        claimed(peg().assembly, [(low, step)], TOLERANCE, choose_separations)


def test_held_contacts_stay_zero_along_the_motion() -> None:
    for c in claims():
        if c.piece.held:
            rows = contact_rows(peg().assembly, c.piece.held, c.piece.held, c.piece.goal)
            assert np.abs(rows.f).max() < 1e-12
