"""Small defects as a hurried change might bring them in: where, what, and why."""

from defect import Defect
from defects_above import ABOVE
from defects_below import BELOW

DEFECTS: tuple[Defect, ...] = (*BELOW, *ABOVE)
from dataclasses import dataclass

ALGEBRA = "tests/estimation/test_armax_algebra.py::"
LEAST_SQUARES = ALGEBRA + "test_theta_is_weighted_least_squares_over_the_regressors_seen"
CONTRACT = "tests/estimation/test_armax_contract.py::"
SURFACE = "tests/channels/test_find_surface.py::"
ALIGN = "tests/channels/test_align.py::"
YAW = "tests/channels/test_yaw_reader.py::"
RESULTS = "tests/results/"
FIND = "tests/manoeuvres/test_find.py::"
FLIGHT = "tests/manoeuvres/test_flight.py::"
STRUCTURES = RESULTS + "test_structures.py::"
TREND = "tests/trend/"
RECORD = "tests/estimation/test_record_fit.py::"


@dataclass(frozen=True, slots=True)
class Defect:
    """``old``, once in ``file`` (below src/yawid), becomes ``new``; then ``test`` must fail."""

    what: str
    file: str
    old: str
    new: str
    test: str


DEFECTS = (
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
        "inputs that move together are let through",
        "results/judge_samples.py",
        "if close > COLLINEAR:",
        "if close > 1.0 + COLLINEAR:",
        "tests/results/test_judge_samples.py::test_inputs_must_be_there_and_not_move_together_nor_at_their_stops",
    ),
    Defect(
        "a replayed signature accepted once more",
        "sources/mavlink/signing.py",
        "if stamp <= self._streams.get(",
        "if stamp < self._streams.get(",
        "tests/sources/mavlink/test_signing.py::test_replayed_frames_are_rejected_and_counted",
    ),
    Defect(
        "a golden comparison that lets a million tolerances pass",
        "runs/regress/compare.py",
        "(np.abs(actual - expected) <= allowed)",
        "(np.abs(actual - expected) <= 1e6 * allowed)",
        "tests/cli/test_regress.py::test_a_mismatch_is_exit_1_and_leaves_rows_and_picture_and_the_way_to_update",
    ),
    Defect(
        "a rudder that is the aileron's copy counts as moved",
        "results/excitation.py",
        "np.minimum(own, whole)",
        "whole",
        RESULTS + "test_excitation.py::test_a_rudder_mixed_from_the_aileron_has_no_part_of_its_own",
    ),
    Defect(
        "the fit on held-back data is not looked at",
        "results/judge_estimate.py",
        "if held_back < LEAST_HELD_BACK_PCT:",
        "if held_back < -1e9 * LEAST_HELD_BACK_PCT:",
        "tests/results/test_verdict.py::test_the_estimate_itself_is_judged",
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
        "nobody asks whether the rudder drives the mode",
        "results/judge_estimate.py",
        "*coherence_reasons(wn, found),",
        "*coherence_reasons(wn, None),",
        RESULTS
        + "test_judge_estimate.py::test_a_line_on_the_gyro_is_no_dutch_roll_whatever_the_fit",
    ),
    Defect(
        "an interrupted replay passes for a whole one",
        "runs/run_log.py",
        "is_whole = False",
        "is_whole = True",
        "tests/runs/test_interrupted.py::test_a_replay_that_was_stopped_is_not_usable_and_bears_its_own_name",
    ),
    Defect(
        "no second before a manoeuvre's first movement",
        "manoeuvres/find.py",
        "LEAD_S = 1.0",
        "LEAD_S = 0.0",
        FIND + "test_it_begins_one_second_before_the_first_movement_and_ends_after_five_of_rest",
    ),
    Defect(
        "twice the stroke that a manoeuvre needs",
        "results/excitation.py",
        "LEAST_STROKE = 0.1",
        "LEAST_STROKE = 0.2",
        FIND + "test_less_than_a_tenth_of_half_the_travel_within_five_seconds_is_none",
    ),
    Defect(
        "a manoeuvre may last two hours",
        "manoeuvres/candidate.py",
        "LONGEST_S = 120.0",
        "LONGEST_S = 7200.0",
        FIND + "test_after_120_seconds_the_rest_is_the_next",
    ),
    Defect(
        "wn of another airspeed taken as it is, without kappa",
        "manoeuvres/flight.py",
        "by = speeds if scaled else np.ones(len(alike))",
        "by = np.ones(len(alike))",
        FLIGHT + "test_over_speeds_wn_is_proportional_and_told_at_the_median",
    ),
    Defect(
        "few manoeuvres that agree by luck are believed",
        "manoeuvres/flight.py",
        "floor * min(1.0, math.sqrt((FEW - 1) / max(n - 1, 1)))",
        "0.0",
        FLIGHT + "test_few_do_not_tell_how_much_they_scatter",
    ),
    Defect(
        "a third of the weight is enough",
        "manoeuvres/flight.py",
        "LEAST_AGREEING = 2.0 / 3.0",
        "LEAST_AGREEING = 1.0 / 3.0",
        FLIGHT + "test_two_that_disagree_are_named_and_the_flight_is_refused",
    ),
    Defect(
        "an autopilot that holds the roll passes for the airframe",
        "manoeuvres/conditions.py",
        "return AIRFRAME if mode in BARE[autopilot] else WITH_ROLL_LOOP",
        "return AIRFRAME",
        "tests/manoeuvres/test_conditions.py::test_no_mode_of_arduplane_is_without_a_loop",
    ),
    Defect(
        "ELS over a record is RML's fit once more",
        "estimation/record_fit.py",
        "fit.gauss_newton(begin, settled) if is_rml else fit.fixed_point(begin)",
        "fit.gauss_newton(begin, settled)",
        RECORD + "test_els_rests_where_scipy_finds_the_root_of_its_own_equations",
    ),
    Defect(
        "what other structures say left out of the total sigma",
        "results/structures.py",
        "return math.hypot(own, apart)",
        "return own",
        STRUCTURES + "test_noise_or_what_the_parts_scatter_and_the_structures_beside_it",
    ),
    Defect(
        "rudder of a coarser grid picked, not its mean",
        "results/structures.py",
        "u = u[: m * every].reshape(m, every, u.shape[1]).mean(axis=1)",
        "u = u[: m * every : every]",
        STRUCTURES + "test_a_coarser_grid_has_the_rudders_mean_and_the_yaw_rate_at_the_instant",
    ),
    Defect(
        "residuals called coloured by p alone",
        "results/judge_estimate.py",
        "if is_coloured and evidence.matters(evidence.next_moves):",
        "if evidence.whiteness_p < WHITE_P:",
        RESULTS + "test_verdict.py::"
        "test_residuals_are_coloured_by_their_size_and_by_what_a_richer_model_makes_of_it",
    ),
    Defect(
        "what all manoeuvres leave out shrinks with their count",
        "manoeuvres/flight.py",
        "np.sqrt(np.mean(beyond**2))",
        "np.sqrt(np.mean(beyond**2) / n)",
        "tests/manoeuvres/test_pooled.py::"
        "test_what_noise_does_not_explain_is_in_common_and_weighs_nothing",
    ),
    Defect(
        "DerSimonian and Laird without the second term of what weights leave over",
        "manoeuvres/flight.py",
        "surplus = total - (weights**2).sum() / total",
        "surplus = total",
        FLIGHT + "test_manoeuvres_at_one_speed_are_told_by_their_pooled_mean",
    ),
    Defect(
        "a trend's outliers judged over one number",
        "trend/trend.py",
        "numbers * two_sided(z, fit.dof)",
        "two_sided(z, fit.dof)",
        TREND + "test_trend.py::test_outliers_and_who_stands_out_are_judged_over_all_numbers",
    ),
    Defect(
        "a vehicle among others judged over one number",
        "trend/trend.py",
        "p = min(1.0, found.p * tested)",
        "p = min(1.0, found.p)",
        TREND + "test_trend.py::test_outliers_and_who_stands_out_are_judged_over_all_numbers",
    ),
    Defect(
        "each of many nights' looks judged as the only one",
        "trend/changes.py",
        "times = nights(n) * looks",
        "times = looks",
        TREND + "test_changes.py::test_p_is_of_all_nights_and_all_profiles_by_students_t",
    ),
    Defect(
        "flights of one day taken for days",
        "trend/days.py",
        "date_us[i] - date_us[i - 1] > NIGHT_US",
        "date_us[i] > date_us[i - 1]",
        TREND + "test_days.py::test_a_day_ends_with_a_night_whatever_the_clock_says",
    ),
    Defect(
        "a run next to its data set without the scatter between flights",
        "trend/diff.py",
        "scatter(np.array(sigma), fitted.tau**2, fitted.s2)",
        "scatter(np.array(sigma), 0.0, fitted.s2)",
        TREND + "test_diff.py::"
        "test_a_run_next_to_its_data_set_is_judged_by_students_t_with_the_scatter_between_flights",
    ),
    Defect(
        "a difference judged as the only one of many",
        "trend/diff.py",
        "min(1.0, judged * two_sided(z, dof))",
        "min(1.0, two_sided(z, dof))",
        TREND + "test_diff.py::test_p_is_of_all_numbers_judged",
    ),
)
