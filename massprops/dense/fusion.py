"""Depth maps that agree, made into one cloud of points with normals, noise and the views that saw them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np


@dataclass(frozen=True)
class DensePoints:
    """Measured surface points.

    Attributes:
        xyz: (n, 3) float32 [units of the reconstruction].
        normal: (n, 3) float32, outward.
        rgb: (n, 3) uint8.
        sigma: (n,) float32, one sigma of the position along the normal.
        view_start: (n + 1,) int32, view_index: (k,) int32: the views that saw point i are
            view_index[view_start[i]:view_start[i + 1]].
    """

    xyz: np.ndarray
    normal: np.ndarray
    rgb: np.ndarray
    sigma: np.ndarray
    view_start: np.ndarray
    view_index: np.ndarray


def nothing_measured() -> DensePoints:
    """No points."""
    none = np.zeros((0, 3), np.float32)
    return DensePoints(none, none, none.astype(np.uint8), none[:, 0], np.zeros(1, np.int32), np.zeros(0, np.int32))


@nb.njit(cache=True, error_model="numpy")
def _fuse(
    reference,
    depth,
    normal,
    sigma,
    taken,
    K,
    R,
    t,
    partners,
    most_reprojection,
    most_depth,
    most_normal,
    agree,
    points,
    normals,
    sigmas,
    pixel,
    counts,
    seen,
):  # type: ignore[no-untyped-def]
    """Fuses the free pixels of one reference with the maps of its partners; gives the number of points written."""
    h, w = depth.shape[1], depth.shape[2]
    n = 0
    fu, fv, cu, cv = K[reference, 0], K[reference, 1], K[reference, 2], K[reference, 3]
    matched = np.empty((len(partners), 3), np.int64)
    for y in range(h):
        for x in range(w):
            d = depth[reference, y, x]
            if d <= 0.0 or taken[reference, y, x]:
                continue
            c0, c1, c2 = (x - cu) / fu * d - t[reference, 0], (y - cv) / fv * d - t[reference, 1], d - t[reference, 2]
            X = R[reference, 0, 0] * c0 + R[reference, 1, 0] * c1 + R[reference, 2, 0] * c2
            Y = R[reference, 0, 1] * c0 + R[reference, 1, 1] * c1 + R[reference, 2, 1] * c2
            Z = R[reference, 0, 2] * c0 + R[reference, 1, 2] * c1 + R[reference, 2, 2] * c2
            m0, m1, m2 = normal[reference, y, x, 0], normal[reference, y, x, 1], normal[reference, y, x, 2]
            N0 = R[reference, 0, 0] * m0 + R[reference, 1, 0] * m1 + R[reference, 2, 0] * m2
            N1 = R[reference, 0, 1] * m0 + R[reference, 1, 1] * m1 + R[reference, 2, 1] * m2
            N2 = R[reference, 0, 2] * m0 + R[reference, 1, 2] * m1 + R[reference, 2, 2] * m2
            # weight by the precision along the normal
            ray = math.sqrt(((x - cu) / fu) ** 2 + ((y - cv) / fv) ** 2 + 1.0)
            facing = -(m0 * (x - cu) / fu + m1 * (y - cv) / fv + m2) / ray
            s = sigma[reference, y, x] * ray * max(facing, 0.05)
            wt = 1.0 / (s * s)
            sw, sx, sy, sz = wt, wt * X, wt * Y, wt * Z
            sn0, sn1, sn2 = wt * N0, wt * N1, wt * N2
            # along the reference's normal: how much the maps scatter
            along, along2 = 0.0, 0.0
            found = 0
            for p in range(len(partners)):
                v = partners[p]
                a = R[v, 0, 0] * X + R[v, 0, 1] * Y + R[v, 0, 2] * Z + t[v, 0]
                b = R[v, 1, 0] * X + R[v, 1, 1] * Y + R[v, 1, 2] * Z + t[v, 1]
                e = R[v, 2, 0] * X + R[v, 2, 1] * Y + R[v, 2, 2] * Z + t[v, 2]
                if e <= 0.0:
                    continue
                u_, v_ = K[v, 0] * a / e + K[v, 2], K[v, 1] * b / e + K[v, 3]
                j, i = int(round(u_)), int(round(v_))
                if i < 0 or j < 0 or i >= h or j >= w:
                    continue
                g = depth[v, i, j]
                if g <= 0.0:
                    continue
                q0, q1, q2 = normal[v, i, j, 0], normal[v, i, j, 1], normal[v, i, j, 2]
                # the partner's plane where the projected ray meets it, not at the pixel's middle
                rx, ry = (u_ - K[v, 2]) / K[v, 0], (v_ - K[v, 3]) / K[v, 1]
                px, py = (j - K[v, 2]) / K[v, 0], (i - K[v, 3]) / K[v, 1]
                slope = q0 * rx + q1 * ry + q2
                if slope > -0.05:
                    continue
                g = g * (q0 * px + q1 * py + q2) / slope
                if abs(g - e) > most_depth * e:
                    continue
                Q0 = R[v, 0, 0] * q0 + R[v, 1, 0] * q1 + R[v, 2, 0] * q2
                Q1 = R[v, 0, 1] * q0 + R[v, 1, 1] * q1 + R[v, 2, 1] * q2
                Q2 = R[v, 0, 2] * q0 + R[v, 1, 2] * q1 + R[v, 2, 2] * q2
                if most_normal > Q0 * N0 + Q1 * N1 + Q2 * N2:
                    continue
                b0, b1, b2 = rx * g - t[v, 0], ry * g - t[v, 1], g - t[v, 2]
                X2 = R[v, 0, 0] * b0 + R[v, 1, 0] * b1 + R[v, 2, 0] * b2
                Y2 = R[v, 0, 1] * b0 + R[v, 1, 1] * b1 + R[v, 2, 1] * b2
                Z2 = R[v, 0, 2] * b0 + R[v, 1, 2] * b1 + R[v, 2, 2] * b2
                # back in the reference
                a = R[reference, 0, 0] * X2 + R[reference, 0, 1] * Y2 + R[reference, 0, 2] * Z2 + t[reference, 0]
                b = R[reference, 1, 0] * X2 + R[reference, 1, 1] * Y2 + R[reference, 1, 2] * Z2 + t[reference, 1]
                e2 = R[reference, 2, 0] * X2 + R[reference, 2, 1] * Y2 + R[reference, 2, 2] * Z2 + t[reference, 2]
                if e2 <= 0.0:
                    continue
                du, dv = fu * a / e2 + cu - x, fv * b / e2 + cv - y
                if du * du + dv * dv > most_reprojection * most_reprojection:
                    continue
                ray = math.sqrt(rx * rx + ry * ry + 1.0)
                s = sigma[v, i, j] * ray * max(-slope / ray, 0.05)
                wt = 1.0 / (s * s)
                sw += wt
                sx += wt * X2
                sy += wt * Y2
                sz += wt * Z2
                sn0 += wt * Q0
                sn1 += wt * Q1
                sn2 += wt * Q2
                off = (X2 - X) * N0 + (Y2 - Y) * N1 + (Z2 - Z) * N2
                along += wt * off
                along2 += wt * off * off
                matched[found, 0], matched[found, 1], matched[found, 2] = v, i, j
                found += 1
            if found < agree:
                continue
            length = math.sqrt(sn0 * sn0 + sn1 * sn1 + sn2 * sn2)
            points[n, 0], points[n, 1], points[n, 2] = sx / sw, sy / sw, sz / sw
            normals[n, 0], normals[n, 1], normals[n, 2] = sn0 / length, sn1 / length, sn2 / length
            scatter = max(along2 / sw - (along / sw) ** 2, 0.0)
            # stated noise, or the scatter where that is larger; neighbouring pixels share half their window
            sigmas[n] = math.sqrt(max(1.0 / sw, scatter / (found + 1)))
            pixel[n] = y * w + x
            counts[n] = found + 1
            seen[n, 0] = reference
            for k in range(found):
                seen[n, k + 1] = matched[k, 0]
                taken[matched[k, 0], matched[k, 1], matched[k, 2]] = True
            taken[reference, y, x] = True
            n += 1
    return n


def fuse(
    depth: np.ndarray,
    normal: np.ndarray,
    sigma: np.ndarray,
    colour: list[np.ndarray],
    K: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    partners: list[np.ndarray],
    view: np.ndarray,
    agree: int = 2,
    most_reprojection: float = 1.0,
    most_depth: float = 0.01,
    most_normal: float = 0.6,
) -> DensePoints:
    """One cloud from all depth maps: each point from a reference pixel and the maps that confirm it.

    Args:
        depth, sigma: (r, h, w) float32; normal: (r, h, w, 3) float32 in each camera.
        colour: per map (h, w, 3) uint8 BGR.
        K: (r, 4) fu fv cu cv; R: (r, 3, 3); t: (r, 3): world to camera.
        partners: per map, the maps it is checked against.
        view: (r,) index of each map's view in the run.
        agree: maps that must confirm a pixel.
        most_reprojection: forward and back [px]; most_depth: relative; most_normal: least cosine.

    Returns:
        points whose normals are outward (towards the cameras that saw them).
    """
    maps, h, w = depth.shape
    taken = np.zeros((maps, h, w), np.bool_)
    parts = []
    widest = max((len(p) for p in partners), default=0) + 1
    points, normals = np.empty((h * w, 3), np.float32), np.empty((h * w, 3), np.float32)
    sigmas, pixel = np.empty(h * w, np.float32), np.empty(h * w, np.int64)
    counts, seen = np.empty(h * w, np.int64), np.empty((h * w, widest), np.int32)
    for r in range(maps):
        if len(partners[r]) < agree:
            continue
        n = _fuse(
            r, depth, normal, sigma, taken, K, R, t, partners[r].astype(np.int64),
            most_reprojection, most_depth, most_normal, agree, points, normals, sigmas, pixel, counts, seen,
        )  # fmt: skip
        rgb = colour[r].reshape(-1, 3)[pixel[:n], ::-1]
        member = np.arange(widest) < counts[:n, None]
        parts.append(
            (
                points[:n].copy(),
                normals[:n].copy(),
                rgb.copy(),
                sigmas[:n].copy(),
                counts[:n].copy(),
                view[seen[:n][member]],
            )
        )
    if not parts:
        empty = np.zeros((0, 3), np.float32)
        return DensePoints(
            empty,
            empty,
            np.zeros((0, 3), np.uint8),
            np.zeros(0, np.float32),
            np.zeros(1, np.int32),
            np.zeros(0, np.int32),
        )
    joined = [np.concatenate([p[k] for p in parts]) for k in range(6)]
    start = np.concatenate([[0], np.cumsum(joined[4])]).astype(np.int32)
    return DensePoints(joined[0], joined[1], joined[2], joined[3], start, joined[5].astype(np.int32))
