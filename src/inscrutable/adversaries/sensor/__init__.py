"""Estimates of a sensor from beliefs or decisions."""

from inscrutable.adversaries.sensor.calibration import calibrate_sensor
from inscrutable.adversaries.sensor.calibration_results import CalibratedSensor, LikelihoodStatus, ProbeRanking
from inscrutable.adversaries.sensor.estimation import estimate_sensor
from inscrutable.adversaries.sensor.families import SensorFamily
from inscrutable.adversaries.sensor.inverse_kalman import LinearView, inverse_kalman_filter
from inscrutable.adversaries.sensor.probes import best_probe
from inscrutable.adversaries.sensor.results import EstimatedSensor, EstimatedWorld, SensorStatus
from inscrutable.adversaries.sensor.world_estimation import estimate_world

__all__ = [
    "CalibratedSensor",
    "EstimatedSensor",
    "EstimatedWorld",
    "LikelihoodStatus",
    "LinearView",
    "ProbeRanking",
    "SensorFamily",
    "SensorStatus",
    "best_probe",
    "calibrate_sensor",
    "estimate_sensor",
    "estimate_world",
    "inverse_kalman_filter",
]
