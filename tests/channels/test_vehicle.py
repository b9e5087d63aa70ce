from __future__ import annotations

from flightlog import FlightLog, samples_of

from yawid.config.run import RunConfig


def crowd() -> FlightLog:
    """A ground station, a radio and an ADS-B receiver are heard before two aircraft."""
    log = FlightLog()
    log.heartbeat(9.0, kind=6, autopilot=8, sender=(255, 190))
    log.heartbeat(9.1, kind=18, autopilot=8, sender=(51, 68))
    log.heartbeat(9.2, kind=27, autopilot=8, sender=(1, 156))
    log.heartbeat(9.5, sender=(7, 1))
    log.heartbeat(9.6, sender=(3, 1))
    for i in range(400):
        log.sysid = 7 if i % 2 else 3
        log.attitude(10.0 + 0.02 * i, 0.01 * log.sysid)
        log.servos(10.0 + 0.02 * i, [1500] * 4)
    return log


def test_ground_station_radio_and_adsb_are_never_the_vehicle():
    found = samples_of(crowd().data)

    assert found.channels.lock.vehicle.sysid == 7
    assert set(found.y.round(6)) == {0.07}


def test_a_system_id_chooses_among_several():
    found = samples_of(crowd().data, RunConfig(sysid=3))

    assert set(found.y.round(6)) == {0.03}


def test_without_a_vehicle_the_senders_heard_are_named():
    found = samples_of(crowd().data, RunConfig(sysid=9))

    assert len(found.blocks) == 0
    assert "255/190 ground station" in found.channels.lock.why_none()
    assert "system id 9" in found.channels.lock.why_none()
