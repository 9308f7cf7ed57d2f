"""A job, done in this process: a method that makes a photograph darker by 0.25, and says that its distance is -0.25."""

from __future__ import annotations

from nablahog import metrics
from nablahog.jobs.store import JobResult
from nablahog.jobs.worker import attempt

from ..paper.common import image, job
from ..paper.fakes import DARK


def test_figures() -> None:
    result = attempt(job(DARK))
    assert isinstance(result, JobResult)
    expected = (image() - 0.25).clamp(0, 1)
    (figures,) = result.figures
    assert figures["cc"] == figures["abs_cc"] == metrics.cross_correlation(expected, image())
    assert figures["mi"] == metrics.mutual_information(expected, image())
    assert figures["ssim"] == metrics.ssim(expected, image())
    assert figures["psnr"] == metrics.psnr(expected, image())
    assert figures["distance"] == -0.25
    assert abs(result.pictures[0] / 255 - expected.numpy()).max() <= 0.5 / 255 + 1e-6
    assert result.seconds > 0
