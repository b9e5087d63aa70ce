"""yawid: how does this aircraft's yaw answer its rudder, right now?"""

__version__ = "0.1.0"
