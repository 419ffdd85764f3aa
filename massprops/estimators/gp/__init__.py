"""Multi-output Gaussian process with the product-periodic kernel, for measurements during an occlusion.

Source: kabir2025 section 2.3 (coregionalised process, product of two periodic kernels, periods from the Fourier
transform). The process is solved in the space of its spectral lines: see `kernel`.
"""

from massprops.estimators.gp.coregionalised import QuasiPeriodicProcess, fit_process

__all__ = ["QuasiPeriodicProcess", "fit_process"]
