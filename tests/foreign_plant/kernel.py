"""The axis itself: three masses, LuGre friction, a Hertzian nut, a cascaded drive; compiled.

All compiled functions live in this one file because a compiled cache follows only its own file.
Motor `m` -coupling and shaft (torsion)- screw `s` -bearing, shaft, nut (axial)- table `x`.
"""

import numpy as np
from numba import njit

TICKS = 8  # speed loop ticks per ms


def compiled(function):
    """Compile and cache, apart for each name this package is imported by: the cache keeps it."""
    function.__qualname__ = f"{__name__.replace('.', '_')}_{function.__name__}"
    return njit(cache=True, error_model="numpy")(function)


@compiled
def lugre(y, v, level, excess, vs, reach, damping, dt):
    """Implicit bristle step -> (new bristle, friction); settles at level (1 + excess e^-|v/vs|)."""
    shape = 1.0 + excess * np.exp(-abs(v) / vs) if excess > 0.0 else 1.0
    y_new = (y + dt * v) / (1.0 + dt * abs(v) / (reach * shape))
    rate = (y_new - y) / dt
    return y_new, level * y_new / reach + damping * rate / (1.0 + (v / (0.2 * vs)) ** 2)


@compiled
def nut_deflection(stretch, d, compliance, hertz, half):
    """Series of a linear spring and two opposed Hertz contacts -> (deflection, force, slope)."""
    force, slope = 0.0, 0.0
    for _ in range(2):
        up = np.sqrt(max(half + d, 0.0))
        down = np.sqrt(max(half - d, 0.0))
        force = hertz * (up * up * up - down * down * down)
        slope = 1.5 * hertz * (up + down)
        d -= (d + compliance * force - stretch) / (1.0 + compliance * slope)
    return d, (stretch - d) / compliance, slope


@compiled
def waves(table, angle, speed):
    """Sum of harmonics (order, amplitude, phase, corner speed) -> (value, derivative by angle)."""
    value, slope = 0.0, 0.0
    for i in range(table.shape[0]):
        order, phase = table[i, 0], table[i, 2]
        a = table[i, 1] / np.sqrt(1.0 + (speed / table[i, 3]) ** 2)
        value += a * np.sin(order * angle + phase)
        slope += a * order * np.cos(order * angle + phase)
    return value, slope


@compiled
def along(row, x, stroke):
    """Value and slope of a table over the stroke at x; held beyond its ends."""
    n = row.shape[0] - 1
    u = min(max(x / stroke * n, 0.0), n - 1e-9)
    i = int(u)
    slope = (row[i + 1] - row[i]) * n / stroke
    return row[i] + (u - i) * stroke / n * slope, slope


@compiled
def nut_state(p, mean_preload, x):
    """Preload (N) at this place of the stroke and half the closure (m) of its contacts."""
    share = 1.0 + p.map_1 * np.sin(2 * np.pi * x / p.stroke + p.map_1_phase)
    share += p.map_2 * np.sin(4 * np.pi * x / p.stroke + p.map_2_phase)
    preload = max(mean_preload * share, 0.0)
    if p.play >= 0.0:
        return preload, -0.5 * p.play
    closure = np.cbrt((preload / p.nut_hertz) ** 2)
    return preload, closure - 0.5 * p.clearance * np.exp(-preload / 10.0)


@compiled
def growth_at(growth, second, x, stroke):
    """Growth of the screw and its slope along x, between two rows a second apart."""
    second = min(second, growth.shape[0] - 1.0001)
    i = int(second)
    before, before_slope = along(growth[i], x, stroke)
    after, after_slope = along(growth[i + 1], x, stroke)
    u = second - i
    return before + u * (after - before), before_slope + u * (after_slope - before_slope)


@compiled
def run(p, sub, lead_in, setpoint, feed, slow, push, growth, walk, rub, ripple, lead, disc, rev):
    """Move along `setpoint` (n,) m at 1 kHz -> states (n, 5), forces (n, 6), energies (8,).

    `p` the Drive; `sub` steps per tick; `lead_in` ms before the recording begins;
    `feed` (n, 2) speed and acceleration; `slow` (k, 7) every 10 ms as SLOW; `push` (n,) N;
    `growth` (g, q) m every second along the stroke; `walk`, `rub` (q,) m and N along the stroke.
    States: motor angle, motor speed, x, table speed, torque command. Forces: nut axial, coupling,
    nut friction, guide friction, bearing friction, torque applied.
    Energies: motor, push, friction, damping, kinetic at the end, stored, tilt, unused.
    """
    n = setpoint.shape[0]
    states = np.empty((n, 5))
    forces = np.empty((n, 6), dtype=np.float32)
    energy = np.zeros(8)
    by_motor, by_push, rubbed, damped, lifted = 0.0, 0.0, 0.0, 0.0, 0.0
    r = p.lead_rad
    dt = 1e-3 / (TICKS * sub)
    tick = 1e-3 / TICKS
    x = setpoint[0]
    th_m = x / r
    th_s, w_m, w_s, v = th_m, 0.0, 0.0, 0.0
    y_b, y_n, y_g, d_nut = 0.0, 0.0, 0.0, 0.0
    integral, w_filtered, torque, command = 0.0, 0.0, 0.0, 0.0
    dwell, seal, chain, memory, accel = 0.0, 0.0, 0.0, 0.0, 0.0
    x_loose, v_loose = x, 0.0
    line = np.zeros(64)
    head = 0
    f_axial, t_shaft, f_chain, f_spring, applied = 0.0, 0.0, 0.0, 0.0, 0.0
    fr_n, fr_g, fr_b = 0.0, 0.0, 0.0
    c_axial, k_torsion = 1.0, 1.0
    sd_b = 2.0 * 0.7 * np.sqrt(p.bearing_c / p.bearing_reach * p.j_motor)
    for k in range(n):
        row = slow[min(max(k - lead_in, 0) // 10, slow.shape[0] - 1)]
        mass = row[1]
        preload, half = nut_state(p, row[0], x)
        nut_level = row[6] * preload * row[3]
        bearing_level = p.bearing_c * row[2]
        shaft = max(x + p.shaft_start, 1e-3)
        c_axial = 1.0 / p.bearing_k + shaft / p.shaft_ae
        k_torsion = 1.0 / (1.0 / p.coupling_k + shaft / p.shaft_gj)
        rubbing, _ = along(rub, x, p.stroke)
        grown, grown_slope = growth_at(growth, max(k - lead_in, 0) / 1000.0, x, p.stroke)
        walked, walked_slope = along(walk, x, p.stroke)
        grown, grown_slope = grown + walked, grown_slope + walked_slope
        x_ms = x
        dwell = dwell + 1e-3 if abs(v) < 2e-4 else 0.0
        if dwell > 0.05:
            seal = max(seal, p.seal_n * np.log10(1.0 + dwell / 0.1))
        seal *= np.exp(-abs(v) * 1e-3 / p.seal_reach)
        guide_level = (p.guide_c * row[4] + max(rubbing, -0.9 * p.guide_c)) + seal
        read, read_slope = waves(disc, th_m, 0.0)
        error = p.kv * (setpoint[k] - r * (th_m + read))
        sd_n = 1.4 * np.sqrt(max(nut_level, 1e-3) / p.nut_reach * p.j_screw)
        sd_g = 1.4 * np.sqrt(guide_level / p.guide_reach * mass)
        for j in range(TICKS):
            head = (head + 1) % 64
            read, read_slope = waves(disc, th_m, 0.0)
            w_filtered += (w_m * (1.0 + read_slope) - w_filtered) * tick / (p.speed_filter + tick)
            nxt = min(k + 1, n - 1)
            wanted = feed[k, 0] + (feed[nxt, 0] - feed[k, 0]) * j / TICKS
            e = (error + wanted) / r - w_filtered
            integral = min(max(integral + p.kp / p.ti * tick * e, -p.integral_max), p.integral_max)
            command = p.kp * e + integral + p.ff_j * feed[k, 1] / r
            command = min(max(command, -p.torque_max), p.torque_max)
            line[head] = command
            if j == 0:
                states[k, 0], states[k, 1] = th_m + read, w_m * (1.0 + read_slope)
                states[k, 2], states[k, 3], states[k, 4] = x, v, command
                forces[k, 0], forces[k, 1], forces[k, 2] = f_axial, t_shaft, fr_n
                forces[k, 3], forces[k, 4], forces[k, 5] = fr_g, fr_b, applied
            late = line[(head - int(p.queue)) % 64]
            late += (p.queue - int(p.queue)) * (line[(head - int(p.queue) - 1) % 64] - late)
            cog, _ = waves(ripple, th_m, w_m)
            cog += p.load_cogging * torque * np.sin(p.load_cogging_order * th_m + 40.0 * x)
            memory += (torque * torque - memory) * tick / p.fatigue_tau
            weak = 1.0 - 0.5 * p.fatigue * memory / (1.0 + p.fatigue * memory)
            wobble, wobble_slope = waves(lead, th_s, 0.0)
            turn, _ = waves(rev, th_s, 0.0)
            th_tick = th_s
            lever = r + wobble_slope
            stall = p.churn * (abs(w_s) / 100.0) ** p.churn_power if p.churn > 0.0 else 0.0
            pull = (f_axial - fr_g) / mass * np.sign(v)
            accel += (max(pull, 0.0) - accel) * tick / 0.02
            for _ in range(sub):
                torque += (late - torque) * dt / (p.lag + dt)
                applied = min(max(torque, -p.applied_limit), p.applied_limit) * p.gain * weak
                applied += cog + p.torque_offset
                y_b, fr_b = lugre(
                    y_b,
                    w_m,
                    bearing_level,
                    p.bearing_excess,
                    p.bearing_vs,
                    p.bearing_reach,
                    sd_b,
                    dt,
                )
                fr_b += p.bearing_visc * row[5] * w_m
                twist = th_m - th_s
                slip = p.torsion_d * (w_m - w_s)
                t_shaft = k_torsion * twist + slip
                gap = r * th_s + wobble + wobble_slope * (th_s - th_tick)
                gap += grown + grown_slope * (x - x_ms) - x
                d_nut, f_spring, slope = nut_deflection(gap, d_nut, c_axial, p.nut_hertz, half)
                damp = p.axial_d * (lever * w_s - v) * slope * c_axial / (0.2 + slope * c_axial)
                f_axial = f_spring + damp
                way = p.asymmetry if w_s > 0.0 else -p.asymmetry
                level = nut_level + p.load_mu * abs(f_axial) + p.accel_drag * accel
                level = max(
                    (level + stall) * (1.0 + way)
                    + (turn + way * (bearing_level + guide_level * r)),
                    0.0,
                )
                y_n, fr_n = lugre(y_n, w_s, level, p.nut_excess, p.nut_vs, p.nut_reach, sd_n, dt)
                fr_n += p.nut_visc * row[5] * w_s
                y_g, fr_g = lugre(
                    y_g, v, guide_level, p.guide_excess, p.guide_vs, p.guide_reach, sd_g, dt
                )
                fr_g += p.guide_visc * row[5] * v
                chain = min(max(chain + dt * v, -p.chain_reach), p.chain_reach)
                f_chain = p.chain_n * chain / p.chain_reach
                f_loose = 0.0
                if p.loose_kg > 0.0:
                    off = x - x_loose
                    over = off - min(max(off, -0.5 * p.loose_gap), 0.5 * p.loose_gap)
                    f_loose = p.loose_k * over + (300.0 * (v - v_loose) if over != 0.0 else 0.0)
                    f_loose += 2.0 * p.loose_kg * np.tanh((v - v_loose) / 1e-3)
                    v_loose += dt * f_loose / p.loose_kg
                    x_loose += dt * v_loose
                w_m += dt * (applied - t_shaft - fr_b) / p.j_motor
                w_s += dt * (t_shaft - f_axial * lever - fr_n) / p.j_screw
                v += dt * (f_axial - fr_g - f_chain - f_loose + push[k] - p.tilt_n) / mass
                th_m += dt * w_m
                th_s += dt * w_s
                x += dt * v
                by_motor += dt * applied * w_m
                by_push += dt * push[k] * v
                rubbed += dt * (fr_b * w_m + fr_n * w_s + fr_g * v + (f_chain + f_loose) * v)
                damped += dt * (slip * (w_m - w_s) + damp * (lever * w_s - v))
                lifted += dt * p.tilt_n * v
    energy[0], energy[1], energy[2], energy[3], energy[6] = (
        by_motor,
        by_push,
        rubbed,
        damped,
        lifted,
    )
    energy[4] = 0.5 * (p.j_motor * w_m**2 + p.j_screw * w_s**2 + slow[-1, 1] * v**2)
    energy[5] = 0.5 * (k_torsion * (th_m - th_s) ** 2 + c_axial * f_spring**2)
    return states, forces, energy
