"""Defects seeded from the bytes to the estimates: sources, channels, estimation, physics."""

from __future__ import annotations

from checks.defect import Defect

ALGEBRA = "tests/estimation/test_armax_algebra.py::"
LEAST_SQUARES = ALGEBRA + "test_theta_is_weighted_least_squares_over_the_regressors_seen"
CONTRACT = "tests/estimation/test_armax_contract.py::"
SURFACE = "tests/channels/test_find_surface.py::"
ALIGN = "tests/channels/test_align.py::"
YAW = "tests/channels/test_yaw_reader.py::"
KEPT = "tests/estimation/test_kept_code.py::"
RECORD = "tests/estimation/test_record_fit.py::"

BELOW = (
    Defect(
        "y enters phi with the wrong sign",
        "estimation/kernel/recursion.py",
        "at.fresh[0] = -y\n",
        "at.fresh[0] = y\n",
        LEAST_SQUARES,
    ),
    Defect(
        "a priori innovation for a posteriori residual in phi",
        "estimation/kernel/recursion.py",
        "at.fresh[len(at.fresh) - 2] = eps if",
        "at.fresh[len(at.fresh) - 2] = e if",
        LEAST_SQUARES,
    ),
    Defect(
        "input one sample too new (nk - 1)",
        "estimation/kernel/new_state.py",
        "rows += [(nk, nb) for",
        "rows += [(nk - 1, nb) for",
        LEAST_SQUARES,
    ),
    Defect(
        "lambda left out of the gain",
        "estimation/kernel/linear_algebra.py",
        "alpha, inverse, column = lam, over, 0",
        "alpha, inverse, column = 1.0, 1.0, 0",
        LEAST_SQUARES,
    ),
    Defect(
        "lambda left out of the growth of P",
        "estimation/kernel/linear_algebra.py",
        "over = 1.0 / lam",
        "over = 1.0",
        LEAST_SQUARES,
    ),
    Defect(
        "forgetting that stays at its start",
        "estimation/kernel/forgetting.py",
        "(1.0 - s.lam_rate) * s.lam_end",
        "(1.0 - s.lam_rate) * lam",
        LEAST_SQUARES,
    ),
    Defect(
        "RML filters by C(q) with the sign of 1/C(q) turned",
        "estimation/kernel/recursion.py",
        "x -= at.c[i] * at.filtered[head]",
        "x += at.c[i] * at.filtered[head]",
        "tests/estimation/test_armax_reference.py::test_two_inputs_agree_and_so_do_predictions",
    ),
    Defect(
        "half of Jury's test left out",
        "estimation/kernel/linear_algebra.py",
        "return abs(a[1]) < 1.0 and abs(a[0]) < 1.0 + a[1]",
        "return abs(a[1]) < 1.0",
        "tests/estimation/test_armax_endurance.py::test_c_stays_stable_at_every_step",
    ),
    Defect(
        "updates before the lags are full",
        "estimation/kernel/recursion.py",
        "learning = s.filled > s.depth + s.nc",
        "learning = s.filled > s.depth",
        LEAST_SQUARES,
    ),
    Defect(
        "lags kept across a gap",
        "estimation/kernel/recursion.py",
        "if s.broken > 0.0:\n        _open(s, at)",
        "if s.broken > 1.0:\n        _open(s, at)",
        CONTRACT + "test_what_lies_before_a_gap_is_no_neighbour_of_what_follows",
    ),
    Defect(
        "no floor under the information",
        "estimation/kernel/forgetting.py",
        "if p > limit:",
        "if p > 1e300 * limit:",
        LEAST_SQUARES,
    ),
    Defect(
        "weights' squares summed without the square",
        "estimation/kernel/forgetting.py",
        "s.s2 = lam * lam * s.s2 + 1.0",
        "s.s2 = lam * s.s2 + 1.0",
        "tests/estimation/test_armax_reference.py::test_filterpy_agrees_to_1e_9",
    ),
    Defect(
        "units of b turned upside down",
        "estimation/kernel/entry_points.py",
        "at.units[i] = at.factors[j] / at.factors[0]",
        "at.units[i] = at.factors[0] / at.factors[j]",
        LEAST_SQUARES,
    ),
    Defect(
        "parameters not taken off in the noise variance",
        "estimation/kernel/forgetting.py",
        "s.loss / max(s.s1 - s.n * s.s2 / s.s1, 1.0)",
        "s.loss / s.s1",
        ALGEBRA + "test_with_nothing_added_it_is_batch_arx",
    ),
    Defect(
        "yaw not unwrapped",
        "channels/yaw_reader.py",
        "unwrapped[rows] = known + 2.0 * np.pi * turns",
        "unwrapped[rows] = known + 0.0 * turns",
        YAW + "test_a_heading_alone_gives_a_coarse_rate",
    ),
    Defect(
        "32-bit servo time not unwrapped",
        "channels/clock.py",
        "unwrapped: Ints = raw + turns * 2**32",
        "unwrapped: Ints = raw + 0 * turns",
        "tests/channels/test_clock.py::test_unwrapping_beside_the_full_clock_inverts_the_wrap",
    ),
    Defect(
        "trim ignored: the middle of the travel for it",
        "channels/surface.py",
        "value = (pwm - trim) /",
        "value = (pwm - 0.5 * (low + high)) /",
        SURFACE + "test_the_deflection_is_what_ardupilot_turned_into_the_pulse",
    ),
    Defect(
        "reversed servo not turned",
        "channels/surface.py",
        "return -value if self.reversed else value",
        "return value",
        SURFACE + "test_the_deflection_is_what_ardupilot_turned_into_the_pulse",
    ),
    Defect(
        "V-tail's elevator taken for its rudder",
        "channels/find_surface.py",
        "return self.servo(left, weight), self.servo(right, -weight)",
        "return self.servo(left, weight), self.servo(right, weight)",
        SURFACE + "test_a_v_tail_is_unmixed_as_ardupilot_mixed_it",
    ),
    Defect(
        "rudder at the instant for its mean over the interval",
        "channels/align.py",
        "mean = np.add.reduceat(area, starts, axis=0) / self._ts_us",
        "mean = self._surface.values[holds[starts]]",
        ALIGN + "test_the_rudder_is_the_mean_of_the_held_value_over_the_interval_that_follows",
    ),
    Defect(
        "yaw rate of the message before for the interpolated",
        "channels/align.py",
        "between = low + weight[:, None] * (high - low)",
        "between = low + 0.0 * weight[:, None] * (high - low)",
        ALIGN + "test_yaw_rate_is_interpolated_to_the_instant",
    ),
    Defect(
        "gaps bridged a hundred times longer",
        "channels/grid_rate.py",
        "BRIDGED = 3.0",
        "BRIDGED = 300.0",
        ALIGN + "test_a_gap_is_a_break_and_never_filled",
    ),
    Defect(
        "turn rate added for subtracted",
        "channels/conditioning.py",
        "y=block.y - turn",
        "y=block.y + turn",
        "tests/channels/test_conditioning.py::test_removing_the_turn_leaves_what_the_bank_did_not_make",
    ),
    Defect(
        "heading rate by Euler with a wrong sign",
        "channels/yaw_reader.py",
        "(q * np.sin(roll) + r * np.cos(roll))",
        "(r * np.cos(roll) - q * np.sin(roll))",
        YAW + "test_the_heading_rate_is_eulers",
    ),
    Defect(
        "zero-order hold not undone in the residues",
        "physics/modes.py",
        "residues: Complexes = discrete * s / (z - 1.0)",
        "residues: Complexes = discrete / sample_time_s",
        "tests/physics/test_derivatives.py::test_the_four_numbers_come_back_from_theta",
    ),
    Defect(
        "sigma of zeta by the wrong slope",
        "physics/modes.py",
        "dzeta = -ds.real / wn + s.real",
        "dzeta = -ds.real / wn - s.real",
        "tests/physics/test_modes.py::test_sigma_by_the_delta_method_is_the_scatter_of_the_poles",
    ),
    Defect(
        "eq. 22: yaw damping with the side force added",
        "physics/derivatives.py",
        "a_omega = 2.0 * xi * omega - a_z",
        "a_omega = 2.0 * xi * omega + a_z",
        "tests/physics/test_derivatives.py::test_the_derivatives_are_those_of_eq_22",
    ),
    Defect(
        "a replayed signature accepted once more",
        "sources/mavlink/signing.py",
        "if stamp <= self._streams.get(",
        "if stamp < self._streams.get(",
        "tests/sources/mavlink/test_signing.py::test_replayed_frames_are_rejected_and_counted",
    ),
    Defect(
        "an autopilot that was never armed is believed",
        "channels/command.py",
        "never_armed = self.disarmed and not self.armed",
        "never_armed = False",
        "tests/channels/test_command.py::test_an_on_board_log_disarmed_throughout_is_refused",
    ),
    Defect(
        "a quadrotor's yaw torque is taken for a rudder",
        "channels/find_surface.py",
        "vehicle.autopilot != ARDUPILOT and has_wings(vehicle)",
        "vehicle.autopilot != ARDUPILOT",
        SURFACE + "test_control_2_is_a_rudder_by_convention_on_wings_alone",
    ),
    Defect(
        "ELS over a record is RML's fit once more",
        "estimation/methods.py",
        "fit=RecordFit.fixed_point",
        "fit=RecordFit.gauss_newton",
        RECORD + "test_els_rests_where_scipy_finds_the_root_of_its_own_equations",
    ),
    Defect(
        "machine code of another processor loaded",
        "estimation/machine/kept.py",
        "(python, processor(), _SETTLED",
        "(python, _SETTLED",
        KEPT + "test_each_processor_and_each_of_its_features_has_code_of_its_own",
    ),
    Defect(
        "machine code loaded whoever wrote the file",
        "estimation/machine/kept.py",
        "is_safe = about.st_uid in (0, os.geteuid()) and not about.st_mode & _FOR_OTHERS",
        "is_safe = True",
        KEPT + "test_a_file_that_another_could_have_written_is_not_loaded_but_made_again",
    ),
    Defect(
        "machine code loaded from a folder in one for all",
        "estimation/machine/kept.py",
        "for each in (folder, *folder.parents):\n        try:",
        "for each in (folder,):\n        try:",
        KEPT + "test_nothing_is_loaded_from_a_folder_that_another_can_write_to",
    ),
    Defect(
        "the nose turned left by PX4's V-tail",
        "channels/find_surface.py",
        '"rudder": (7, 8, 0.5, -0.5)',
        '"rudder": (7, 8, -0.5, 0.5)',
        SURFACE + "test_px4s_v_tail_turns_the_nose_right_by_the_left_ruddervator_up",
    ),
    Defect(
        "a ULog's true airspeed taken before the calibrated one",
        "sources/logs/ulog.py",
        "itertools.product(topics, _AIRSPEED), itertools.product(topics, (_TRUE,))",
        "itertools.product(topics, (_TRUE,)), itertools.product(topics, _AIRSPEED)",
        "tests/sources/logs/test_ulog.py::"
        "test_a_true_airspeed_is_the_last_resort_and_converted_by_the_air_s_density",
    ),
    Defect(
        "a knot one percent too long",
        "quantities/units.py",
        "1852.0 / 3600.0",
        "1870.0 / 3600.0",
        "tests/sources/records/test_airspeeds.py::test_a_unit_is_what_it_is_by_definition",
    ),
    Defect(
        "a true airspeed converted by the density, not its root",
        "quantities/airspeed.py",
        "true_m_s * np.sqrt(ratio)",
        "true_m_s * ratio",
        "tests/sources/records/test_airspeeds.py::"
        "test_a_true_airspeed_is_converted_by_the_altitude",
    ),
    Defect(
        "an airspeed of zero is one",
        "quantities/airspeed.py",
        "(airspeed >= LEAST_M_S)",
        "(airspeed >= 0.0)",
        "tests/manoeuvres/test_unknown_airspeeds.py::"
        "test_the_bounds_are_next_to_nothing_and_three_times_sound",
    ),
    Defect(
        "the publisher's ten seconds are five: twice the bytes",
        "sources/link/publisher.py",
        "self._sent[0][0] > WINDOW_S",
        "self._sent[0][0] > WINDOW_S / 2",
        "tests/sources/link/test_publisher.py::"
        "test_what_was_sent_counts_for_ten_seconds_both_ends_of_them_included",
    ),
    Defect(
        "a vehicle's address is the newest",
        "sources/link/inbox.py",
        "if now_us - self._first_us.get(sysid, -SILENT_US) >= SILENT_US:",
        "if now_us >= self._first_us.get(sysid, -SILENT_US):",
        "tests/sources/link/test_sender_addresses.py::"
        "test_the_address_first_heard_from_stays_until_it_has_been_silent_for_ten_seconds",
    ),
)
