from .images import (
    DEFINITIONS as DEFINITIONS,
    MEASURES as MEASURES,
    cross_correlation as cross_correlation,
    mutual_information as mutual_information,
    psnr as psnr,
    ssim as ssim,
)
from .viewpoints import (
    VIEW_COUNTS as VIEW_COUNTS,
    azimuth_error as azimuth_error,
    near_view as near_view,
    rotation_error as rotation_error,
    same_view as same_view,
    view as view,
)
