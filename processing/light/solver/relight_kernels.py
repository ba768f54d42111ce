"""Compiled loops of relighting: sums over stored rays, shots at what the sun lights, and smoothing along surfaces."""

from __future__ import annotations

import math

import numpy as np

from processing.light.solver.kernels import FIRST, SECOND, STEP_OFF_M, compiled


@compiled
def add_sky(first, cell, tint, weight, colours, values, out, apart):  # type: ignore[no-untyped-def]
    """Add the light (n, 3) of stored rays to the sky: ``first`` (n + 1,) says where each point's rays begin.

    ``apart`` (n,): half the difference in the green channel between the odd rays' and the even rays' estimate.
    """
    for i in range(out.shape[0]):
        r = g = b = odd = 0.0
        for k in range(first[i], first[i + 1]):
            c, t, w = cell[k], tint[k], weight[k]
            r += w * colours[t, 0] * values[c, 0]
            light = w * colours[t, 1] * values[c, 1]
            g += light
            b += w * colours[t, 2] * values[c, 2]
            odd += light if k & 1 else -light
        out[i, 0] += r
        out[i, 1] += g
        out[i, 2] += b
        apart[i] += odd


@compiled
def add_bounced(links, density, table, bright, shots, out, apart):  # type: ignore[no-untyped-def]
    """Add the mean radiosity that stored rays met; of bright patches the balance heuristic's share (see `transport`).

    ``table`` (patches, 4): radiosity that counts in full, and the density of the ``shots`` at a bright patch (0: none);
    ``bright`` (patches, 3): radiosity that is weighted against them.
    """
    samples = links.shape[1]
    for i in range(links.shape[0]):
        r = g = b = odd = 0.0
        for s in range(samples):
            k = links[i, s]
            if k < 0:
                continue
            light = table[k, 1]
            r += table[k, 0]
            b += table[k, 2]
            if table[k, 3] > 0:
                found = samples * density[i, s]
                share = found / (found + shots * table[k, 3])
                r += share * bright[k, 0]
                light += share * bright[k, 1]
                b += share * bright[k, 2]
            g += light
            odd += light if s & 1 else -light
        out[i, 0] += r / samples
        out[i, 1] += g / samples
        out[i, 2] += b / samples
        apart[i] += odd / samples


@compiled
def settle_onwards(links, albedo, first, total, most, least):  # type: ignore[no-untyped-def]
    """Bring irradiance ``total`` (n, 3) to balance: first + mean of albedo x total over what each point's rays met.

    Each patch takes what is newest of the others (Gauss and Seidel), which takes half the rounds of a bounce at a time.
    Ends once what is still to come is below ``least`` of all light; returns whether it does within ``most`` rounds.
    """
    samples = links.shape[1]
    radiosity = albedo * total
    before = 0.0
    for turn in range(most):
        change = whole = 0.0
        for i in range(links.shape[0]):
            r = g = b = 0.0
            for s in range(samples):
                k = links[i, s]
                if k >= 0:
                    r += radiosity[k, 0]
                    g += radiosity[k, 1]
                    b += radiosity[k, 2]
            r, g, b = first[i, 0] + r / samples, first[i, 1] + g / samples, first[i, 2] + b / samples
            change += abs(r - total[i, 0]) + abs(g - total[i, 1]) + abs(b - total[i, 2])
            whole += r + g + b
            total[i, 0], total[i, 1], total[i, 2] = r, g, b
            radiosity[i, 0], radiosity[i, 1], radiosity[i, 2] = albedo[i, 0] * r, albedo[i, 1] * g, albedo[i, 2] * b
        ratio = change / before if turn > 0 and before > 0 else 0.0
        if turn > 1 and ratio < 1 and change * ratio <= least * whole * (1 - ratio):
            return True
        if change == 0.0:
            return True
        before = change
    return False


@compiled
def aim(points, normals, shift, goals, goal_normals, shots, origins, rays, chosen, point):  # type: ignore[no-untyped-def]
    """Fill rays (n x shots, 3) from points to some of ``goals`` (m, 3) that face them; return how many there are.

    ``chosen``: which goal; ``point``: whose ray, shots of one point in turn. Rays are not of unit length: they end at
    the goal at 1. The sign of ``point`` (counted from 1) tells a point's odd shots, which are negative.
    """
    count, used = goals.shape[0], 0
    for i in range(points.shape[0]):
        for s in range(shots):
            k = int(((shift[i] + s / shots) % 1.0) * count)
            here = there = 0.0
            for c in range(3):
                origins[used, c] = points[i, c] + STEP_OFF_M * normals[i, c]
                rays[used, c] = goals[k, c] - origins[used, c]
                here += rays[used, c] * normals[i, c]
                there -= rays[used, c] * goal_normals[k, c]
            if here > 0 and there > 0:
                chosen[used] = k
                point[used] = -(i + 1) if s & 1 else i + 1
                used += 1
    return used


@compiled
def add_shots(  # type: ignore[no-untyped-def]
    normals, goal_normals, light, chance, chosen, point, rays, seen, shots, samples, out, apart
):
    """Add what aimed shots that are ``seen`` bring, weighted against ``samples`` cosine rays (see `aim`)."""
    for j in range(seen.shape[0]):
        if not seen[j]:
            continue
        i, k = abs(point[j]) - 1, chosen[j]
        far2 = here = there = 0.0
        for c in range(3):
            far2 += rays[j, c] * rays[j, c]
            here += rays[j, c] * normals[i, c]
            there -= rays[j, c] * goal_normals[k, c]
        form = here * there / (math.pi * max(far2 * far2, 1e-16))
        share = form / (shots * chance[k] + samples * form)
        out[i, 0] += share * light[k, 0]
        out[i, 1] += share * light[k, 1]
        out[i, 2] += share * light[k, 2]
        apart[i] += share * light[k, 1] if point[j] < 0 else -share * light[k, 1]


@compiled
def likeness(label, normal, point, near_m, radius, wraps, weights):  # type: ignore[no-untyped-def]
    """Fill what each pixel's neighbours tell of it: (h, w, (2 radius + 1)²) of 0 to 255, 255 for itself.

    Neighbours of another surface, another direction or off the plane tell nothing; others the less the farther they
    are against ``near_m`` (h, w), the distance over which irradiance changes there.
    """
    rows, columns = label.shape
    side = 2 * radius + 1
    for y in range(rows):
        for x in range(columns):
            if label[y, x] < 0:
                continue
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    r, c = y + dy, x + dx
                    if r < 0 or r >= rows or ((c < 0 or c >= columns) and not wraps):
                        continue
                    c = c % columns
                    if label[r, c] != label[y, x]:
                        continue
                    turned = lift = far2 = 0.0
                    for k in range(3):
                        turned += normal[y, x, k] * normal[r, c, k]
                        step = point[r, c, k] - point[y, x, k]
                        lift += step * normal[y, x, k]
                        far2 += step * step
                    if turned < 0.9 or abs(lift) > 0.01 + 0.1 * math.sqrt(far2):
                        continue
                    share = 255 * math.exp(-0.5 * far2 / max(near_m[y, x] * near_m[y, x], 1e-8))
                    weights[y, x, (dy + radius) * side + dx + radius] = int(share + 0.5)


@compiled
def smooth(values, weights, radius, out):  # type: ignore[no-untyped-def]
    """Fill the weighted means of ``values`` (h, w + 2 radius, 4), whose columns go on beyond both sides: (h, w, 4)."""
    rows, columns = out.shape[0], out.shape[1]
    side = 2 * radius + 1
    for y in range(rows):
        for x in range(columns):
            if weights[y, x, radius * side + radius] == 0:
                continue
            total = a = b = c = d = np.float32(0)
            for dy in range(max(-radius, -y), min(radius, rows - 1 - y) + 1):
                at = (dy + radius) * side
                for dx in range(side):
                    w = np.float32(weights[y, x, at + dx])
                    total += w
                    a += w * values[y + dy, x + dx, 0]
                    b += w * values[y + dy, x + dx, 1]
                    c += w * values[y + dy, x + dx, 2]
                    d += w * values[y + dy, x + dx, 3]
            out[y, x, 0], out[y, x, 1], out[y, x, 2], out[y, x, 3] = a / total, b / total, c / total, d / total


@compiled
def relative_apart(values, pixel, weights):  # type: ignore[no-untyped-def]
    """Return the mean square of the fourth channel over luminance, of some pixels of ``values`` (n, 4)."""
    total = 0.0
    for i in pixel:
        level = weights[0] * values[i, 0] + weights[1] * values[i, 1] + weights[2] * values[i, 2]
        off = values[i, 3] / max(level, 1e-9)
        total += off * off
    return total / max(len(pixel), 1)


@compiled
def disc_rays(points, normals, axis, side, other, tangent, shift, samples, origins, rays):  # type: ignore[no-untyped-def]
    """Fill rays (n, samples, 3) spread evenly over a disc of directions; one sample: to its middle."""
    for i in range(points.shape[0]):
        for s in range(samples):
            radius = 0.0 if samples == 1 else tangent * math.sqrt((shift[i, 0] + (s + 0.5) * FIRST) % 1.0)
            angle = 2 * math.pi * ((shift[i, 1] + (s + 0.5) * SECOND) % 1.0)
            p, q = radius * math.cos(angle), radius * math.sin(angle)
            length = math.sqrt(1.0 + radius * radius)
            for c in range(3):
                origins[i, s, c] = points[i, c] + STEP_OFF_M * normals[i, c]
                rays[i, s, c] = (axis[c] + p * side[c] + q * other[c]) / length
