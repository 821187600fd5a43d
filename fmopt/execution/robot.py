"""The robot that carries plans out: apparent mass, servo, force sensor, and when it has felt a contact."""

from dataclasses import dataclass
from math import exp, pi, sqrt


@dataclass(frozen=True)
class Robot:
    """A compliant tool held by a hybrid position/force servo."""

    mass: float = 0.5
    gyration: float = 0.02  # m about the reference point; it makes inertia and turning stiffness of mass and stiffness
    stiffness: float = 20000.0  # of the servo, N/m
    damping: float = 0.7  # less than critical, or tight parts rattle between their walls at the controller's rate
    resistances: tuple[float, float] = (1000.0, 1.0)  # of force-controlled axes on the way, N·s/m and N·m·s/rad
    memory: float = 0.1  # s over which slow changes of the force signal count as the level that a touch rises above
    settling: float = 0.15  # s in which the part settles before each move
    settled: tuple[float, float] = (400.0, 0.06)
    learning: float = 0.02  # s over which the servo learns the coefficient of friction that it makes up for
    period: float = 0.001
    cut_off: float = 60.0  # of the low-pass filter on the force signal, Hz
    # Deviations of force (N) and torque (N·m) in a raw sample; the filter leaves 43 %, less than what stops allow
    noise: tuple[float, float] = (0.1, 0.002)
    # s over which the force of the new contacts is averaged, where it alone tells of them, and where the part has been
    # braked as well; pace is averaged over the longer
    averaging: tuple[float, float] = (0.01, 0.03)
    alert: float = 0.15  # share of what a plan's stop allows for friction and noise that is left after the averaging
    debounce: int = 3
    patience: int = 40
    doubling: float = 0.05  # s in which the push doubles while the part stands and no contact is felt
    slow: float = 0.6
    braked: tuple[float, float] = (0.75, 0.6)
    lasting: float = 0.7  # share of what a plan's stop allows that tells of the contact, averaged over the longer time
    # Pushes at which a part that stands may have met the contact, and the share of the force that tells so if braked
    stuck: tuple[float, float] = (3.0, 0.5)
    standing: float = 0.2
    surplus: float = 1.3
    leeway: float = 1.5
    haste: float = 0.005  # s in which the push that comes on top, at the start of a move, brings the part to its speed
    turning: float = 0.25  # greatest speed of turning, rad/s; moves that the plan turns faster are run more slowly

    @property
    def starting(self) -> float:
        """s at the start of a move in which the part may be pushed harder, and in which nothing is felt."""
        return 6.0 * self.haste

    @property
    def inertia(self) -> float:
        """About each axis, kg·m²."""
        return self.mass * self.gyration**2

    @property
    def stiffnesses(self) -> tuple[float, float]:
        """N/m and N·m/rad."""
        # By the same square as inertia and damping, so that turning has the frequency and damping ratio of translation.
        return self.stiffness, self.stiffness * self.gyration**2

    @property
    def dampings(self) -> tuple[float, float]:
        """N·s/m and N·m·s/rad."""
        d = 2.0 * self.damping * sqrt(self.stiffness * self.mass)
        return d, d * self.gyration**2

    @property
    def smoothing(self) -> float:
        """Weight of a new sample in the first-order filter."""
        # What the continuous filter takes up in a period; 2π f T, its first term, would be a fifth more.
        return 1.0 - exp(-2.0 * pi * self.cut_off * self.period)
