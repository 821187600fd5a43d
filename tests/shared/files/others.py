"""Meshes that other people made, where their folder lies beside the repository."""

from fmopt.geometry.mesh.mesh_import import Unit
from tests import ROOT

PARTS = ROOT.parent / "shared" / "parts"
PAIRS: dict[str, tuple[str, str, Unit, float]] = {  # peg, hole, unit, clearance a side in mm
    "factory_rect_8mm_loose": (
        "factory_rectangular_peg_8mm_loose_subdiv_3x.obj",
        "factory_rectangular_hole_8mm_subdiv_3x.obj",
        "m",
        0.5 * (8.144 - 7.964),
    ),
    "factory_round_16mm_tight": (
        "factory_round_peg_16mm_tight.obj",
        "factory_round_hole_16mm_subdiv_3x.obj",
        "m",
        0.5 * (16.5 - 15.994),
    ),
    "agh_6gon": ("6gon_peg.stl", "6gon_box_t5mm.stl", "mm", 0.433),
}
