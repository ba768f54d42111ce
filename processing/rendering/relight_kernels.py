"""Compiled loops of relighting: sums over stored rays, shots at what the sun lights, and smoothing along surfaces."""

from __future__ import annotations

import math

from processing.rendering.kernels import FIRST, SECOND, STEP_OFF_M, compiled


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
def add_bounced(links, density, radiosity, bright, chance, shots, out, apart):  # type: ignore[no-untyped-def]
    """Add the mean radiosity that stored rays met; of bright patches the balance heuristic's share (see `transport`).

    ``radiosity`` (patches, 3) counts in full, ``bright`` (patches, 3) weighted against ``shots`` of density ``chance``.
    """
    samples = links.shape[1]
    for i in range(links.shape[0]):
        r = g = b = odd = 0.0
        for s in range(samples):
            k = links[i, s]
            if k < 0:
                continue
            light = radiosity[k, 1]
            r += radiosity[k, 0]
            b += radiosity[k, 2]
            if chance[k] > 0:
                found = samples * density[i, s]
                share = found / (found + shots * chance[k])
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
def aim(points, normals, shift, goals, goal_normals, shots, origins, rays, chosen):  # type: ignore[no-untyped-def]
    """Fill rays (n, shots) from points to some of ``goals`` (m, 3); ``chosen`` (n, shots): which, -1 where hidden.

    Rays are not of unit length: they end at the goal at 1.
    """
    count = goals.shape[0]
    for i in range(points.shape[0]):
        for s in range(shots):
            k = int(((shift[i] + s / shots) % 1.0) * count)
            here = there = 0.0
            for c in range(3):
                origins[i, s, c] = points[i, c] + STEP_OFF_M * normals[i, c]
                rays[i, s, c] = goals[k, c] - origins[i, s, c]
                here += rays[i, s, c] * normals[i, c]
                there -= rays[i, s, c] * goal_normals[k, c]
            chosen[i, s] = k if here > 0 and there > 0 else -1


@compiled
def add_shots(  # type: ignore[no-untyped-def]
    normals, goal_normals, light, chance, chosen, rays, seen, shots, samples, out, apart
):
    """Add what aimed shots (n, shots) that are ``seen`` bring, weighted against ``samples`` cosine rays."""
    for i in range(normals.shape[0]):
        for s in range(shots):
            k = chosen[i, s]
            if k < 0 or not seen[i, s]:
                continue
            far2 = here = there = 0.0
            for c in range(3):
                far2 += rays[i, s, c] * rays[i, s, c]
                here += rays[i, s, c] * normals[i, c]
                there -= rays[i, s, c] * goal_normals[k, c]
            form = here * there / (math.pi * max(far2 * far2, 1e-16))
            share = form / (shots * chance[k] + samples * form)
            out[i, 0] += share * light[k, 0]
            out[i, 1] += share * light[k, 1]
            out[i, 2] += share * light[k, 2]
            apart[i] += share * light[k, 1] if s & 1 else -share * light[k, 1]


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
    """Fill the weighted means of ``values`` (h, w, 4); columns wrap."""
    rows, columns = values.shape[0], values.shape[1]
    side = 2 * radius + 1
    for y in range(rows):
        for x in range(columns):
            total = 0.0
            a = b = c = d = 0.0
            for dy in range(max(-radius, -y), min(radius, rows - 1 - y) + 1):
                at = (dy + radius) * side + radius
                for dx in range(-radius, radius + 1):
                    w = weights[y, x, at + dx]
                    if w == 0:
                        continue
                    k = x + dx
                    if k < 0:
                        k += columns
                    elif k >= columns:
                        k -= columns
                    total += w
                    a += w * values[y + dy, k, 0]
                    b += w * values[y + dy, k, 1]
                    c += w * values[y + dy, k, 2]
                    d += w * values[y + dy, k, 3]
            if total > 0:
                out[y, x, 0], out[y, x, 1], out[y, x, 2], out[y, x, 3] = a / total, b / total, c / total, d / total


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
