"""Error sets in fixed point: outer descriptions of where the pose error can be.

Errors that are fixed in the hole or in the hand: how their generators move on, and what the linear picture leaves.

With a hole that is askew by H, a grasp that is off by G, and κ for what robot and contacts add in the world, the part's
pose in the hole's frame is H⁻¹ · (C ⊕ κ) · G for the commanded pose C = (p̄, R̄). With the turn h and shift h_p of the
hole about the start position p̄₀ and the error g = (g_p, g_r) in the hand,

    e = h_p + h × (p̄ − p̄₀) + κ_p + R̄ g_p + q_e,    ε = h + κ_r + R̄ g_r + q_ε,

    |q_e| ≤ ½|h|²P + |h|(|κ_p| + |g_p|) + |κ_r||g_p|,    |q_ε| ≤ ½ab(1 + a + b) + ½|h|c(1 + |h| + c),

a = |κ_r|, b = |g_r|, c = a + b, P = |p̄ − p̄₀|; |κ_p| ≤ |e| + |h_p| + |h|P + |g_p| and |κ_r| ≤ |ε| + |h| + |g_r|.
Between the ends of a piece that turns by τ, R̄ g is off its chord by τ²/8 of its size. All of it counts against every
row; it does not add up along the way.

Linear algebra in error coordinates (e, ε): rows and columns of six, square matrices of six rows.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from operator import mul

from fmopt.verify.arithmetic.rational import (
    BITS,
    BLUR,
    ONE,
    ZERO3,
    ArithmeticRefusal,
    Matrix,
    Row,
    Square,
    Vector,
    add,
    cross,
    fixed,
    inverse,
    length,
    over,
    root,
    row_dot,
    spread,
    sub,
    times,
    turned,
    vector,
    width,
)
from fmopt.verify.reading.document import StatedPlan
from fmopt.verify.reading.reader import FIXED_IN

SIX = range(6)
_UPPER = [(a, b) for a in SIX for b in range(a, 6)]  # places on and above the diagonal
_LEAST, _MOST = ONE >> 50, ONE << 50  # proportions of two ellipsoids, beyond which one is but rounding

NO_ROW: Row = (0, 0, 0, 0, 0, 0)


@dataclass(frozen=True)
class ErrorShape:
    """Errors known from outside in two ways: in Zonotope(core, thickness) ⊕ slide ⊕ swing, and in shape."""

    core: tuple[Row, ...]  # generators that are images of the start box
    thick: tuple[Row, ...]  # generators of the thickness of the last piece's contact surfaces
    slide: Square  # shape matrix (6, 6) of the ellipsoid of what velocity errors add in translation
    swing: Square  # shape matrix (6, 6) of the ellipsoid of what they add in rotation
    shape: Square  # shape matrix (6, 6) of the ellipsoid around everything
    # How the first generators of the core move on with the part; None where all stay as they are
    linkage: "CheckedLinkage | None" = None

    @cached_property
    def generators(self) -> tuple[Row, ...]:
        """All generators."""
        return self.core + self.thick

    def support(self, N: Row) -> int:
        """Bound of N·e over the set."""
        return self._support(self.generators, N)

    def core_support(self, N: Row) -> int:
        """Bound of N·e over the set without its thickness."""
        return self._support(self.core, N)

    def _support(self, generators: Sequence[Row], N: Row) -> int:
        around, inside = width(self.shape, N), spread(generators, N)
        # The smaller of two bounds that both hold; the second is not computed where the first cannot be beaten.
        return around if around <= inside else min(around, inside + self.drift(N))

    def drift(self, N: Row) -> int:
        """Bound of N·e over what velocity errors add."""
        return width(self.slide, N) + width(self.swing, N)

    def half_widths(self, thick: Sequence[Row]) -> list[int]:
        """Half-widths (6,) of the box around core, this thickness and drifts."""
        gens = (*self.core, *thick)
        return [sum(abs(g[a]) for g in gens) + sum(root(Q[a][a] + BLUR) for Q in (self.slide, self.swing)) for a in SIX]


def start_errors(plan: StatedPlan) -> ErrorShape:
    """The start box |eₐ| ≤ half-width of a plan; its ellipsoid is stretched by the root of the number of axes."""
    a = [fixed(x) for x in plan.start_box]
    axes = [k for k in SIX if a[k] > 0]
    # k a² on the diagonal for k axes: Σ (x/a)² ≤ k in the box.
    shape = diagonal([len(axes) * times(x, x) + (BLUR if x else 0) for x in a]) if axes else NOTHING
    core, linkage = linkage_of(plan)
    return ErrorShape(core, (), NOTHING, NOTHING, shape, linkage)


@dataclass(frozen=True)
class CheckedLinkage:
    """How the first generators of an error set move on with the part."""

    hole: tuple[Vector, ...]  # turns of the hole (3,), rad; zero for generators that are not fixed there
    hand: tuple[Row, ...]  # generators fixed in the hand, as they are turned now; zero for others
    sizes: tuple[int, int, int, int]  # bounds of |h_p|, |h|, |g_p| and |g_r|
    origin: Vector  # p̄₀

    @property
    def linked(self) -> int:
        """How many generators move on otherwise than the world's."""
        return sum(h != ZERO3 or g != NO_ROW for h, g in zip(self.hole, self.hand, strict=True))

    def turned(self, turn: Matrix) -> "CheckedLinkage":
        """The linkage after the part has turned."""
        return replace(self, hand=tuple(turned(turn, g[:3]) + turned(turn, g[3:]) for g in self.hand))

    def moves(self, travel: Vector, turn: Matrix, count: int) -> tuple[Row, ...]:
        """By how much `count` generators move as the part turns and its reference point travels, m.

        Generators behind the linked ones do not move.
        """
        after = self.turned(turn).hand
        found = []
        for h, old, new in zip(self.hole, self.hand, after, strict=True):
            # A turn of the hole by h moves what is fixed there by h × travel; what is in the hand turns with it.
            found.append(row_of((*add(sub(new[:3], old[:3]), cross(h, travel)), *sub(new[3:], old[3:]))))
        # Generators of the world come last, and stay as they are.
        return (*found, *[NO_ROW] * (count - len(found)))

    def left(self, offset: int, angle: int, ends: Sequence[Vector], turn: int) -> tuple[int, int]:
        """What the linear picture leaves of errors of at most these sizes over a piece between two positions.

        Args:
            offset: bound of |e|, m.
            angle: bound of |ε|, rad.
            ends: both positions of the piece, m.
            turn: bound of how far the piece turns, rad.

        Raises:
            ArithmeticRefusal: the errors are too large for its bounds.
        """
        shift, askew, off, slant = self.sizes
        travel = max(length(sub(p, self.origin)) for p in ends)
        moved = offset + shift + times(askew, travel) + off
        a = angle + askew + slant
        c = a + slant
        # Half a radian: up to there the bounds below hold.
        if askew + c > ONE >> 1:
            raise ArithmeticRefusal("errors fixed in different frames are too large for the bounds of this check")
        arc = times(turn, turn) >> 3
        straight = (times(times(askew, askew), travel) >> 1) + times(askew, moved + off) + times(a + arc, off)
        round_ = (times(times(a, slant), ONE + c) >> 1) + (times(times(askew, c), ONE + askew + c) >> 1)
        return straight + 8, round_ + times(arc, slant) + 8  # 8: more than products are cut off by


def linkage_of(plan: StatedPlan) -> tuple[tuple[Row, ...], CheckedLinkage | None]:
    """The generators of a plan's start errors, and how they move on; None where all are fixed in the world."""
    boxes = {"world": plan.start_box} if not plan.sources else dict(plan.sources)
    rows: list[Row] = []
    hole: list[Vector] = []
    hand: list[Row] = []
    # Each frame has generators of its own: errors of one axis in two frames vary independently.
    for frame in FIXED_IN:
        for k, half in enumerate(boxes.get(frame, ())):
            if half > 0.0:
                g = row_of(fixed(half) if j == k else 0 for j in range(6))
                rows.append(g)
                # A shift of the hole stays as it is: only its turn swings what has moved on.
                hole.append(g[3:] if frame == "hole" else ZERO3)
                hand.append(g if frame == "hand" else NO_ROW)
    if not plan.sources:
        return tuple(rows), None
    none = (0.0,) * 6
    askew, grip = boxes.get("hole", none), boxes.get("hand", none)
    shift, turn, off, slant = (length(vector(box[k : k + 3])) for box in (askew, grip) for k in (0, 3))
    origin = vector(plan.segments[0].start[:3])
    return tuple(rows), CheckedLinkage(tuple(hole), tuple(hand), (shift, turn, off, slant), origin)


def row_of(values: Iterable[int]) -> Row:
    """Six numbers as a row."""
    a, b, c, d, e, f = values
    return (a, b, c, d, e, f)


def square_of(rows: Iterable[Iterable[int]]) -> Square:
    """Six rows as a matrix."""
    a, b, c, d, e, f = [row_of(r) for r in rows]
    return (a, b, c, d, e, f)


def symmetric(upper: Iterable[int]) -> Square:
    """The symmetric matrix with these 21 entries on and above its diagonal, row by row."""
    aa, ab, ac, ad, ae, af, bb, bc, bd, be, bf, cc, cd, ce, cf, dd, de, df, ee, ef, ff = upper
    return (
        (aa, ab, ac, ad, ae, af),
        (ab, bb, bc, bd, be, bf),
        (ac, bc, cc, cd, ce, cf),
        (ad, bd, cd, dd, de, df),
        (ae, be, ce, de, ee, ef),
        (af, bf, cf, df, ef, ff),
    )


NOTHING: Square = square_of([NO_ROW] * 6)


def diagonal(entries: Sequence[int]) -> Square:
    """The matrix with these six diagonal entries."""
    return symmetric([entries[a] if a == b else 0 for a, b in _UPPER])


def stretched(factor: int, g: Row) -> Row:
    """factor · g."""
    return row_of([(factor * x) >> BITS for x in g])


def flipped(A: Square) -> Square:
    """Aᵀ."""
    return square_of(zip(*A, strict=True))


def image(A: Square, g: Row) -> Row:
    """A g."""
    a, b, c, d, e, f = g
    return row_of([(a * u + b * v + c * w + d * x + e * y + f * z) >> BITS for u, v, w, x, y, z in A])


def seen(n: Row, A: Square) -> Row:
    """Aᵀ n: the row n as it is felt before the map A."""
    return image(flipped(A), n)


def congruent(A: Square, Q: Square) -> Square:
    """A Q Aᵀ for a symmetric Q."""
    if Q == NOTHING:
        return NOTHING
    half = flipped(square_of([image(A, q) for q in Q]))
    return symmetric([row_dot(A[a], half[b]) for a, b in _UPPER])


def spheres(A: Square) -> tuple[Square, Square]:
    """A D Aᵀ with D = diag(1, 1, 1, 0, 0, 0) and with D = diag(0, 0, 0, 1, 1, 1)."""
    columns = flipped(A)
    return gram(columns[:3]), gram(columns[3:])


def magnified(s: int, P: Square) -> Square:
    """s P of a symmetric P."""
    return symmetric([(s * P[a][b]) >> BITS for a, b in _UPPER])


def gram(columns: Sequence[Row]) -> Square:
    """Σ c cᵀ."""
    return symmetric([sum([c[a] * c[b] for c in columns]) >> BITS for a, b in _UPPER])


def blurred(Q: Square) -> Square:
    """A symmetric Q with its diagonal raised by more than rounding can have lowered it."""
    return symmetric([Q[a][b] + BLUR if a == b else Q[a][b] for a, b in _UPPER])


@lru_cache(maxsize=4)
def dual(directions: tuple[Row, ...], rows: tuple[Row, ...]) -> tuple[tuple[Row, ...], tuple[tuple[int, ...], ...]]:
    """The columns of C (N C)⁻¹, and (N C)⁻¹, for directions C and rows N.

    Where a piece of motion starts, they are those of the end of the piece before. Rows are of the contacts held.

    Raises:
        ArithmeticRefusal: see `inverse`.
    """
    if not directions:
        return (), ()
    # Rows along directions: how much each contact feels of each direction that gives way.
    solved = inverse([[row_dot(n, c) for c in directions] for n in rows])
    along = list(zip(*directions, strict=True))
    columns = [row_of([sum(map(mul, shares, c)) >> BITS for c in along]) for shares in zip(*solved, strict=True)]
    return tuple(columns), tuple(tuple(r) for r in solved)


def complement(columns: Sequence[Row], rows: Sequence[Row]) -> Square:
    """I − Σ cᵢ nᵢᵀ; without columns cᵢ the identity."""
    if not columns:
        return diagonal([ONE] * 6)
    across = list(zip(*rows, strict=True))
    return square_of(
        [(ONE if a == b else 0) - (sum(map(mul, shares, n)) >> BITS) for b, n in enumerate(across)]
        for a, shares in enumerate(zip(*columns, strict=True))
    )


def without(A: Square, c: Row, n: Row) -> Square:
    """A − c nᵀ."""
    return square_of([[x - ((k * m) >> BITS) for x, m in zip(r, n, strict=True)] for r, k in zip(A, c, strict=True)])


def metric(rho: int) -> Row:
    """The diagonal of the metric |e|² + ρ²|ε|²."""
    square = times(rho, rho)
    return (ONE, ONE, ONE, square, square, square)


def measure(v: Row, rho: int) -> int:
    """√(|e|² + ρ²|ε|²) of a twist (e, ε), m and rad."""
    return root(sum([times(w, times(x, x)) for w, x in zip(metric(rho), v, strict=True)]))


def outer_sum(Q1: Square, Q2: Square, weights: Row) -> Square:
    """An ellipsoid around the sum of two: (1 + 1/p)Q₁ + (1 + p)Q₂, p = √tr Q₁/√tr Q₂ in the metric.

    A summand without extent is left out. Both, symmetric and positive semidefinite but for `BLUR`, are blurred first: a
    factor may be large where a summand is small, though not so large that what is but blur would count.
    """
    # The sum with a point is the other summand itself, without the factors.
    if Q1 == NOTHING or Q2 == NOTHING:
        return Q1 if Q2 == NOTHING else Q2
    s1, s2 = (root(sum([times(weights[a], Q[a][a] + BLUR) for a in SIX])) for Q in (Q1, Q2))
    p = min(max(over(s1, s2), _LEAST), _MOST)
    # Rounded up, so that 1/α + 1/β ≤ 1 holds of the two factors whatever p is.
    alpha, beta = ONE + (ONE << BITS) // p + 1, ONE + p
    blur = (alpha + beta) * BLUR
    return symmetric([(alpha * Q1[a][b] + beta * Q2[a][b] + (blur if a == b else 0)) >> BITS for a, b in _UPPER])
