"""The names by which files say what a camera is, without capitals and what is neither letter nor digit."""

from __future__ import annotations

import re

MATRICES = (
    *("cameramatrix", "intrinsicmatrix", "intrinsicsmatrix", "k", "camk", "mtx", "intrinsics", "intrinsic"),
    *("cameraintrinsics", "calibrationmatrix"),
)
DISTORTIONS = (
    *("distortioncoefficients", "distortioncoefficient", "distortioncoeffs", "distortioncoeff", "distortioncoefs"),
    *("distcoefficients", "distcoeffs", "distcoeff", "distcoefs", "distcoef", "dist", "distortion", "d"),
    *("distortionparameters", "distortionparams", "coefficients", "coeffs"),
)
PARTS = {
    **dict.fromkeys(("radial", "radialdistortion"), ("k1", "k2", "k3")),
    **dict.fromkeys(("tangential", "tangentialdistortion"), ("p1", "p2")),
}
"""Names of the coefficients of a part of the distortion, as MATLAB writes them."""
COEFFICIENT = re.compile("(?:distortion|dist|lens|radial|tangential)?(k[1-6]|p[12])")
HEIGHTS, WIDTHS = ("height", "imageheight", "h"), ("width", "imagewidth", "w")
PAIRS = ("imagesize", "imgsize", "imageshape", "size", "resolution", "imageresolution")
"""Names of both sides, in any order."""
GROUPS = (
    *(*MATRICES, *DISTORTIONS, *PAIRS, "camera", "cameraparameters", "cameraparams", "calibration"),
    *("projectionparameters", "lens", "lensdistortion"),
)
"""Names of what may hold what else is outside."""
INTRINSICS = {
    **{"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"},
    **{"flx": "fx", "fly": "fy", "ppx": "cx", "ppy": "cy"},
}
MODEL_KEYS = (
    *("model", "type", "modeltype", "cameramodel", "cameratype", "distortionmodel", "distortiontype"),
    *("lensmodel", "lenstype", "projection", "projectiontype", "projectionmodel"),
)
MODELS = (
    *("plumbbob", "radtan", "radialtangential", "opencv", "brownconrady", "brown", "simpleradial", "radial"),
    *("rationalpolynomial", "pinhole", "simplepinhole", "perspective", "none", "null", ""),
)
"""Names of the model of five coefficients, of those that are the same if all further ones are 0, and of none."""
SAME_WITHOUT_COEFFICIENTS = ("inversebrownconrady", "modifiedbrownconrady")
"""Models that are none if all coefficients are 0, as RealSense's cameras often have them."""
FISHEYES = ("fisheye", "equidist", "kannala")  # parts of names of models that are not read, by whatever key
HARMLESS = re.compile(
    # when, by what and how well it was calibrated
    ".*(?:date|time|stamp|error|residual|stddev|deviation|covariance|version|serial|flags).*|rms|rms?e|std.*|.*std"
    "|.*(?:count|board|square|marker|pattern|corners).*|(?:image|object|world|grid|control)points"
    "|(?:num|nr|n)(?:of)?(?:images|frames|views|photos)|header|fps|framerate|ratehz|exposure.*|iso|gain|sharpness"
    "|.*id|.*index|seq"
    # where it was, and other pictures than its photographs
    "|.*(?:extrinsic|rotation|translation|transform|rvec|tvec|camtoworld|worldtocam).*|cam[rt]w2c|t(?:bs|cam.*|cn.*)?"
    "|r|p|rectificationmatrix|projectionmatrix|.*depthscale|aabbscale|camoverlaps"
    # what follows from the intrinsics, or is in other units
    "|.*fov[xy]?|cameraangle[xy]|(?:fixed)?aspectratio|sensor(?:width|height|size)(?:mm)?|pixelsize.*|focal(?:length)?mm"
)
"""Names of numbers on which a camera's photographs do not depend."""
_AS_FOUR = "write `intrinsics` as fx,fy,cx,cy of the photograph as it is, and the coefficients as `distortion`"
_NO_SKEW = "calibrate the camera without skew, which pixels of photographs do not have"
REMEDIES = {
    **dict.fromkeys(("skew", "s", "gamma", "alphac"), _NO_SKEW),
    **dict.fromkeys(("binningx", "binningy", "binning", "xoffset", "yoffset"), _AS_FOUR),
    **dict.fromkeys(("f", "focal", "focallength"), "write fx and fy, in pixels"),
    **dict.fromkeys(("principalpoint", "pp", "c"), "write cx and cy, in pixels"),
}
"""What to do about numbers by other names."""
