"""A trimmed tlog is whole records of the stretch asked for, bytes untouched."""

from flights.surgery import join, message_id, split
from places import REPLAY_LOGS
from pymavlink.dialects.v20 import ardupilotmega
from trim_tlog import trim


def test_trimming_keeps_whole_records_of_the_window_and_the_messages_named() -> None:
    log = (REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog").read_bytes()

    part = trim(log + b"torn", 63.0, 66.0, ["ATTITUDE", "HEARTBEAT"])

    records, decoder = split(part), ardupilotmega.MAVLink(None)
    within = [each for each in split(log) if records[0][0] <= each[0] <= records[-1][0]]
    attitudes = [bytearray(frame) for _, frame in records if message_id(frame) == 30]
    boot_ms = [decoder.decode(frame).time_boot_ms for frame in attitudes]
    assert join(records) == part
    assert records == [each for each in within if message_id(each[1]) in (0, 30)]
    assert 63_000 <= boot_ms[0] < 63_150  # ATTITUDE comes at 10 Hz
    assert 65_850 <= boot_ms[-1] < 66_000
