"""Settings of the physics engine, and which of them can be trusted at clearances of hundredths of a millimetre.

The engine's own defaults soften contacts over 20 ms and let a 0.2 mm interference fit go in; what is found here keeps
penetration at or below some 25 µm at 50 mm/s, and in proportion to the time constant of the contacts.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

from fmopt.errors import SettingsError

TIME_STEP = 0.0005  # s; contacts have to relax over two of them at least
HARD = 0.001  # s, time constant of contacts
SLOWEST = 10.0  # s of that a metre of clearance


@dataclass(frozen=True)
class Physics:
    """What the engine is told."""

    time_step: float = TIME_STEP  # s
    # Time constant (s) and damping ratio of contacts; None for HARD, or two time steps if that is more, and 1: a
    # smaller step then resolves the same contacts better, instead of making them harder
    solref: tuple[float, float] | None = None
    solimp: tuple[float, ...] = (0.99, 0.999, 1e-4, 0.5, 2.0)
    impratio: float = 10.0
    cone: str = "elliptic"
    margin: float = 0.0  # distance at which contacts begin, m

    @staticmethod
    def of_fit(clearance: float, period: float, time_step: float | None = None) -> Physics:
        """What keeps the penetration under a fifth of a clearance, m, at the speeds of insertion.

        Contacts are as hard as the clearance of a side, m, asks for, whatever the time step (s). The time step is half
        the time constant of the contacts, or less, if not given; the controller's period (s) is a multiple of it.
        """
        hard = min(HARD, SLOWEST * clearance)
        # A whole number in a period; what is taken off keeps rounding from making it one more.
        step = period / ceil(2.0 * period / hard - 1e-9) if time_step is None else time_step
        return Physics(step, (max(2.0 * step, hard), 1.0))

    @property
    def contact(self) -> tuple[float, float]:
        """solref as it is used."""
        return self.solref or (max(2.0 * self.time_step, HARD), 1.0)

    def trusted(self) -> Physics:
        """These settings.

        Raises:
            SettingsError: a result with them would say nothing about tight fits.
        """
        if faults := _faults(self):
            advice = "leave the settings of contacts out: interference fits go in with the engine's defaults"
            raise SettingsError("untrustworthy physics: " + "; ".join(faults), advice)
        return self


def _faults(physics: Physics) -> list[str]:
    (constant, damping), longest = physics.contact, max(2.5 * physics.time_step, HARD)
    checks = (
        (0.0 < physics.time_step <= 0.001, f"time step {physics.time_step:g} s, at most 0.001"),
        (0.0 < constant <= longest, f"contacts give way over {constant:g} s, at most {longest:g}"),
        (damping >= 1.0, f"contacts bounce, damping ratio {damping:g}, at least 1"),
        (physics.solimp[0] >= 0.99, f"contact impedance from {physics.solimp[0]:g}, at least 0.99"),
        (physics.impratio >= 10.0, f"friction creeps, impratio {physics.impratio:g}, at least 10"),
        (physics.cone == "elliptic", f"{physics.cone} friction cones, not elliptic"),
        (physics.margin == 0.0, f"a contact margin of {physics.margin:g} m eats the clearance"),
    )
    return [words for good, words in checks if not good]
