"""The same frame with OpenCV, and with numpy and scipy: all that can be prepared is, single precision throughout.

Both do what the kernel does but for dithering: table of the target, patch sums by a sparse product, dense product
of patch size, smooth indirect light, black, mixing, clamp, table of the projector by the square root of light in 8
bits, which is the fastest that keeps within a code or two.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from rig.benchmark.references.live_scene import LiveScene
from sim.frame.codes import fractional_code
from sim.frame.compensator import FrameModel
from sim.geometry.scene import Scene
from sim.reference.frame import layers

Codes = NDArray[np.uint8]
Float32 = NDArray[np.float32]
ROOT_STEPS = 255


class _Prepared:
    """What both use, pixel by pixel and channels last."""

    def __init__(self, model: FrameModel) -> None:
        height, width = model.shape
        n = height * width
        runs = model.patch_runs.of_pixels(model.shape).ravel()
        patch = model.patch_runs.value[runs, 0]
        emission = model.emission.values[0].ravel()
        inverse = np.moveaxis(layers(model.inverse_direct), 0, 2)
        self.inverse: Float32 = np.ascontiguousarray(inverse, dtype=np.float32)
        self.offset: Float32 = np.ascontiguousarray(np.moveaxis(layers(model.offset), 0, 2), dtype=np.float32)
        self.gain: Float32 = np.ascontiguousarray(np.moveaxis(layers(model.view_gain), 0, 2), dtype=np.float32)
        self.eotf: Float32 = np.asarray((model.target_scale[:, None] * model.eotf).T[:, None, :], dtype=np.float32)
        self.sums = csr_array((emission.astype(np.float32), (patch, np.arange(n))), shape=(model.n_lit, n))
        self.black: Float32 = model.black_emission.astype(np.float32)
        # On gridded walls, which peers are for, a node is a patch.
        matrices = model.inverse.values.astype(np.float32)
        self.matrices = np.broadcast_to(matrices, (3, *matrices.shape[1:]))
        self.unmixing: Float32 = np.linalg.inv(model.mixing).astype(np.float32)
        share = (np.arange(ROOT_STEPS + 1) / ROOT_STEPS) ** 2
        light = share[:, None] * model.response[:, -1]
        codes = [np.rint(fractional_code(model.response[c], light[:, c])) for c in range(3)]
        # One response for all channels in this bench.
        self.response: Codes = codes[0].astype(np.uint8)
        self.shape = (height, width, 3)

    def irradiance(self, light: Float32) -> Float32:
        """(W, 3) irradiance of the viewed patches for wanted light over D (H, W, 3)."""
        sums = (self.sums @ light.reshape(-1, 3)).T - self.black
        return np.stack([matrix @ row for matrix, row in zip(self.matrices, sums, strict=True)], axis=1)


class NumpyFrame(_Prepared):
    """A frame with numpy and scipy.sparse."""

    def __init__(self, model: FrameModel) -> None:
        super().__init__(model)
        cells = model.cells
        corners = cells.corners[cells.runs.value[cells.runs.of_pixels(model.shape).ravel(), 0]]
        x, y = (cells.place.reshape(2, -1) / np.float32(255)).astype(np.float32)
        weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)
        indptr = np.arange(0, 4 * len(x) + 1, 4)
        self.view = csr_array((weights.ravel(), corners.ravel(), indptr), shape=(len(x), self.matrices.shape[1]))
        self.table: Float32 = np.ascontiguousarray(self.eotf[:, 0, :])

    def __call__(self, codes: Codes) -> Codes:
        """Give the projector's codes."""
        light = np.empty(self.shape, dtype=np.float32)
        for band in range(3):
            np.take(self.table[:, band], codes[..., band], out=light[..., band])
        light *= self.inverse
        seen = (self.view @ self.irradiance(light)).reshape(self.shape)
        light -= self.offset
        seen *= self.gain
        light -= seen
        share = light.reshape(-1, 3) @ self.unmixing.T
        np.clip(share, 0, 1, out=share)
        np.sqrt(share, out=share)
        share *= ROOT_STEPS
        return self.response[(share + np.float32(0.5)).astype(np.uint8)].reshape(self.shape)


class OpenCvFrame(_Prepared):
    """A frame with OpenCV: tables, remap from an atlas of the faces, transform."""

    def __init__(self, live: LiveScene, model: FrameModel) -> None:
        super().__init__(model)
        self.atlas, self.map, self.weights = _atlas(live)
        used = np.unique(live.transport.bands[0].view.indices)
        place = self.atlas[used]
        self.rows, self.columns = place.T
        self.size = tuple(int(side) + 2 for side in self.atlas.max(axis=0))

    def __call__(self, codes: Codes) -> Codes:
        """Give the projector's codes."""
        light = np.asarray(cv2.LUT(codes, self.eotf), dtype=np.float32)
        cv2.multiply(light, self.inverse, dst=light)
        atlas = np.zeros((*self.size, 3), dtype=np.float32)
        atlas[self.rows, self.columns] = self.irradiance(light)
        seen = cv2.remap(atlas, self.map, self.weights, cv2.INTER_LINEAR)
        cv2.subtract(light, self.offset, dst=light)
        cv2.subtract(light, cv2.multiply(seen, self.gain, dst=seen), dst=light)
        share = cv2.transform(light, self.unmixing)
        _, share = cv2.threshold(share, 0.0, 0.0, cv2.THRESH_TOZERO, dst=share)
        root = cv2.convertScaleAbs(cv2.sqrt(share, dst=share), alpha=float(ROOT_STEPS))
        return np.asarray(cv2.LUT(root, self.response))


def _atlas(live: LiveScene) -> tuple[NDArray[np.intp], NDArray[np.int16], NDArray[np.uint16]]:
    """(P, 2) row and column of each patch in one picture of all faces, and each pixel's place in it for remap."""
    if not isinstance(live.scene, Scene):
        raise TypeError("OpenCV looks up gridded walls alone")
    patches = np.empty((live.scene.n_patches, 2), dtype=np.intp)
    place = np.zeros((live.lens.n_pixels, 2), dtype=np.float32)
    top = 0
    for index, face in enumerate(live.scene.faces):
        row, column = np.divmod(np.arange(face.n_patches), face.columns)
        patches[face.patches] = np.stack([row + top, column], axis=1)
        pixels = np.flatnonzero(live.hits.face == index)
        cell = live.hits.uv[pixels] * (face.columns, face.rows) - 0.5
        place[pixels] = np.clip(cell, 0, (face.columns - 1, face.rows - 1)) + np.array([0, top])
        top += face.rows
    steps, weights = cv2.convertMaps(place.reshape(*live.lens.shape, 2), np.empty(0, np.float32), cv2.CV_16SC2)
    return patches, steps.astype(np.int16), weights.astype(np.uint16)
