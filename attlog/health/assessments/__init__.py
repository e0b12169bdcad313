"""Can these sensors be trusted, and what should be set? One file per question; each answers with assessments."""

from attlog.health.assessments.model import Assessment, HealthCase, MotionAttitude, Setting, Verdict, unknown
from attlog.health.assessments.offered import offered
from attlog.health.assessments.topics import TOPICS, SensorQuestion

__all__ = [
    "TOPICS",
    "Assessment",
    "HealthCase",
    "MotionAttitude",
    "SensorQuestion",
    "Setting",
    "Verdict",
    "offered",
    "unknown",
]
