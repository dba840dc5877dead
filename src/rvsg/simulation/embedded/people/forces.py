"""The forces of the social force model as HuNavSim's lightsfm computes them. Unit mass: a force is an acceleration.

Sources: Moussaïd et al., Experimental study of the behavioural mechanisms underlying self-organization in human
crowds (2009) for the social force; Moussaïd et al., The walking behaviour of pedestrian social groups (2010) for the
group force. The constants are lightsfm's defaults.
"""

from __future__ import annotations

import math

from rvsg.core.kernels import inner, kernel

LAMBDA = 2.0
GAMMA = 0.35
N_ANGLE = 2.0
N_SPEED = 3.0
SIGMA_OBSTACLE_M = 0.2
RELAXATION_S = 0.5
GAZE = 3.0
COHERENCE = 2.0
REPULSION = 1.0


@kernel
def wrap(angle: float) -> float:
    """The angle in (-π, π]."""
    while angle <= -math.pi:
        angle += 2.0 * math.pi
    while angle > math.pi:
        angle -= 2.0 * math.pi
    return angle


@kernel
def desired_force(
    dx: float, dy: float, goal_radius: float, vx: float, vy: float, speed: float, factor: float
) -> tuple[float, float]:
    """Pull towards a goal at (dx, dy) from here, m/s²: factor (speed·e - v) / 0.5 s; a brake where it is reached."""
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > goal_radius:
        return (
            factor * (speed * dx / distance - vx) / RELAXATION_S,
            factor * (speed * dy / distance - vy) / RELAXATION_S,
        )
    return -vx / RELAXATION_S, -vy / RELAXATION_S


@kernel
def obstacle_force(dx: float, dy: float, radius: float, factor: float) -> tuple[float, float]:
    """Push away from an obstacle point; (dx, dy) points from it to the human. factor·exp(-(d - radius)/0.2 m)."""
    distance = math.sqrt(dx * dx + dy * dy)
    size = factor * math.exp(-(distance - radius) / SIGMA_OBSTACLE_M)
    return size * dx / distance, size * dy / distance


@kernel
def social_force(
    dx: float, dy: float, dvx: float, dvy: float, factor: float, reach: float, aside: bool = False
) -> tuple[float, float]:
    """Return the push of another person at (dx, dy) from here; (dvx, dvy) is own velocity less the other's.

    With ê the direction to the other, I = 2 (v - v_j) + ê, B = 0.35 |I| and θ the angle from I to ê:
    -exp(-D/B - (3Bθ)²) along I and -sign(θ) exp(-D/B - (2Bθ)²) across it.
    `reach` bounds the exponent (infinity: no bound): a pair beyond it is weaker than √2·factor·exp(-reach) and counts
    as zero, because |θ| >= |sin θ|. `aside`: at θ = 0, where the model has no sideways push, push to the right; two
    people who meet head-on would otherwise stop each other.
    """
    distance = math.sqrt(dx * dx + dy * dy)
    ex = dx / distance
    ey = dy / distance
    ix = LAMBDA * dvx + ex
    iy = LAMBDA * dvy + ey
    square = ix * ix + iy * iy
    # The test below, without roots and with some room for rounding: most pairs are beyond reach.
    cross = N_ANGLE * GAMMA * (ix * ey - iy * ex)
    rest = reach - cross * cross + 1e-6
    if rest < 0.0 or distance * distance > 1.000001 * GAMMA * GAMMA * rest * rest * square:
        return 0.0, 0.0
    length = math.sqrt(square)
    b = GAMMA * length
    tx = ix / length
    ty = iy / length
    decay = distance / b
    sine = N_ANGLE * b * (tx * ey - ty * ex)
    if decay + sine * sine > reach:
        return 0.0, 0.0
    theta = math.atan2(tx * ey - ty * ex, tx * ex + ty * ey)
    speed_angle = N_SPEED * b * theta
    turn_angle = N_ANGLE * b * theta
    along = -math.exp(-decay - speed_angle * speed_angle)
    across = -math.exp(-decay - turn_angle * turn_angle)
    if theta < 0.0:
        across = -across
    elif theta == 0.0 and not aside:
        across = 0.0
    return factor * (along * tx - across * ty), factor * (along * ty + across * tx)


@inner
def pair_force(dx: float, dy: float, dvx: float, dvy: float, reach: float) -> tuple[float, float, float]:
    """Return the push of `social_force` for a factor of 1, and the exponent that is compared with a person's reach.

    It pushes to the right at θ = 0. The other person of the pair is pushed by the same, the other way: both see the
    same angle and the same distance. `reach` is the larger one of both; beyond it the exponent is infinite.
    """
    distance = math.sqrt(dx * dx + dy * dy)
    ex = dx / distance
    ey = dy / distance
    ix = LAMBDA * dvx + ex
    iy = LAMBDA * dvy + ey
    length = math.sqrt(ix * ix + iy * iy)
    b = GAMMA * length
    tx = ix / length
    ty = iy / length
    decay = distance / b
    sine = N_ANGLE * b * (tx * ey - ty * ex)
    exponent = decay + sine * sine
    if exponent > reach:
        return 0.0, 0.0, math.inf
    theta = math.atan2(tx * ey - ty * ex, tx * ex + ty * ey)
    speed_angle = N_SPEED * b * theta
    turn_angle = N_ANGLE * b * theta
    along = -math.exp(-decay - speed_angle * speed_angle)
    across = -math.exp(-decay - turn_angle * turn_angle)
    if theta < 0.0:
        across = -across
    return along * tx - across * ty, along * ty + across * tx, exponent


@inner
def is_beyond(dx: float, dy: float, dvx: float, dvy: float, reach: float) -> bool:
    """Whether `social_force` is surely zero, told without a division or a branch: most pairs are. Room for rounding.

    With d the way to the other and v the relative velocity, I x ê = 2 (v x d) / |d| and |I|² = 4 |v|² + 1 +
    4 (v · d) / |d|. Both tests of `social_force` are taken times a power of |d|.
    """
    square = dx * dx + dy * dy
    cross = N_ANGLE * GAMMA * LAMBDA * (dvx * dy - dvy * dx)
    rest = (1.00001 * reach + 1e-5) * square - cross * cross
    moving = LAMBDA * LAMBDA * (dvx * dvx + dvy * dvy)
    room = 1.0001 * GAMMA * GAMMA * rest * rest
    cube = square * square * square
    distance = math.sqrt(square)
    along = (moving + 1.0001) * distance + 2.0 * LAMBDA * (dvx * dx + dvy * dy)
    return (rest < 0.0) | (cube > room * (2.0 * moving + 2.0)) | (cube * distance > room * along)


@kernel
def reach_of(factor: float, neglect: float) -> float:
    """The exponent beyond which a pair's force is below `neglect` (m/s²); infinity where nothing is neglected."""
    return math.log(math.sqrt(2.0) * factor / neglect) if neglect > 0.0 and factor > 0.0 else math.inf


@kernel
def gaze_force(ex: float, ey: float, cx: float, cy: float) -> tuple[float, float]:
    """Pull back towards the other members (centre at (cx, cy) from here) where they are out of sight behind."""
    along = ex * cx + ey * cy
    if along >= 0.0:
        return 0.0, 0.0
    return GAZE * along * ex, GAZE * along * ey


@kernel
def coherence_force(cx: float, cy: float, members: int) -> tuple[float, float]:
    """Pull towards the centre of the whole group at (cx, cy) from here, growing beyond (members - 1)/2 metres."""
    distance = math.sqrt(cx * cx + cy * cy)
    size = COHERENCE * 0.5 * (1.0 + math.tanh(distance - (members - 1) / 2.0))
    return size * cx, size * cy


@kernel
def or_zero(fx: float, fy: float) -> tuple[float, float]:
    """The force, or none where it is undefined (two at the very same spot)."""
    if math.isfinite(fx) and math.isfinite(fy):
        return fx, fy
    return 0.0, 0.0
