"""How flights ended: impacts, overturns, tumbles, hard landings, and the time in which a vehicle was a wreck."""

from attlog.segments.crash.blows import fast_enough
from attlog.segments.crash.scene import Ending
from attlog.segments.crash.wrecks import Flown, Wreck, find

__all__ = ["Ending", "Flown", "Wreck", "fast_enough", "find"]
