"""Latent images on one NVIDIA GPU: twins of the operators and solvers of the rooms below, with kernels of our own.

Only `rsvideo.gpu.device` may be imported without the extra `gpu`; the rest needs CuPy and numba-cuda, or numba-cuda's simulator.
"""
