"""How does a sensor err? Its detections beside the truth."""

from dirprim_filter.evaluation.calibration.calibrating import Calibration as Calibration
from dirprim_filter.evaluation.calibration.calibrating import calibrate as calibrate
from dirprim_filter.evaluation.calibration.self_calibration import self_calibrate as self_calibrate
