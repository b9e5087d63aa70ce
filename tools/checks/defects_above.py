"""Defects seeded above the estimates: results, manoeuvres, sinks, live sessions, data sets."""

from __future__ import annotations

from checks.defect import Defect

RESULTS = "tests/results/"
FIND = "tests/manoeuvres/test_find.py::"
FLIGHT = "tests/manoeuvres/test_flight.py::"
STRUCTURES = RESULTS + "test_structures.py::"
OTHERS = "tests/dataset/test_read_by_others.py::"
KNOWN = "tests/fleet/test_known_logs.py::"
TREND = "tests/trend/"

ABOVE = (
    Defect(
        "inputs that move together are let through",
        "results/judge_samples.py",
        "if close > COLLINEAR:",
        "if close > 1.0 + COLLINEAR:",
        "tests/results/test_judge_samples.py::test_inputs_must_be_there_and_not_move_together_nor_at_their_stops",
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
        "nobody asks whether the rudder drives the mode",
        "results/judge_estimate.py",
        "*coherence_reasons(wn, found),",
        "*coherence_reasons(wn, None),",
        RESULTS
        + "test_judge_estimate.py::test_a_line_on_the_gyro_is_no_dutch_roll_whatever_the_fit",
    ),
    Defect(
        "an interrupted replay passes for a whole one",
        "runs/job.py",
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
        "an airspeed off by a factor of two is believed",
        "manoeuvres/airspeed_check.py",
        "FACTOR: Final = 1.2",
        "FACTOR: Final = 2.2",
        "tests/manoeuvres/test_airspeed_check.py::"
        "test_a_factor_seen_on_several_headings_is_reported",
    ),
    Defect(
        "what a richer structure moves left out of the total sigma",
        "results/structures.py",
        "return float(np.fmax(apart, moves[MOVED.index(name)]))",
        "return apart",
        "tests/manoeuvres/test_answer.py::"
        "test_a_roll_on_a_runway_is_refused_where_a_richer_structure_moves_wn",
    ),
    Defect(
        "a take-off roll is one manoeuvre for its first five seconds",
        "manoeuvres/candidate.py",
        "        other |= speed_factors(speeds, self._few) > OTHER_SPEED\n",
        "",
        FIND + "test_another_airspeed_ends_it_within_its_first_five_seconds_too",
    ),
    Defect(
        "a rudder that follows the yaw rate is believed to move it",
        "results/judge_samples.py",
        "if before < LEAST_RESPONSE or before <= after:",
        "if before < LEAST_RESPONSE:",
        "tests/channels/test_command.py::test_a_rudder_that_follows_the_yaw_rate_is_a_passengers",
    ),
    Defect(
        "sigma of wn / V not divided by V",
        "dataset/summary_rows.py",
        '(f"{stem}_std", value.std),',
        '(f"{stem}_std", None if value.std is None else value.std / scale),',
        "tests/dataset/test_summary_rows.py::"
        "test_kappa_and_k_over_v_and_all_their_sigmas_are_divided_by_the_airspeed",
    ),
    Defect(
        "old files stay where the new ones come",
        "dataset/places.py",
        "    for name in set(_own_files(folder)) - named:\n        (folder / name).unlink",
        "    for name in set():\n        (folder / name).unlink",
        OTHERS + "test_killed_at_any_step_a_glob_reads_no_row_twice_and_the_next_merge_completes",
    ),
    Defect(
        "the analysis version left out of what a fleet knows",
        "fleet/run_fleet.py",
        """if row is None or (row["config_hash"], row["analysis_version"]) != (
        config_hash,
        ANALYSIS_VERSION,
    ):""",
        'if row is None or row["config_hash"] != config_hash:',
        KNOWN + "test_a_log_is_known_where_all_that_its_numbers_depend_on_is_the_same",
    ),
    Defect(
        "a log that failed for a passing reason is known for ever",
        "fleet/run_fleet.py",
        'if row["outcome"] == FAILED or (',
        "if (",
        KNOWN + "test_a_log_is_known_where_all_that_its_numbers_depend_on_is_the_same",
    ),
    Defect(
        "the time of a log without a date is 1970",
        "tables/columns.py",
        'np.where(samples.unix_ns < FIRST_DATE_NS, np.datetime64("NaT"), time)',
        "time",
        "tests/tables/test_export.py::"
        "test_the_time_of_a_log_without_a_date_is_unknown_and_not_1970",
    ),
    Defect(
        "a run compared with a fleet that holds its own log",
        "trend/history.py",
        'rows = [row for row in rows if row["log_sha256"] != without_sha]',
        "rows = list(rows)",
        "tests/trend/test_own_log.py::"
        "test_a_run_is_compared_with_the_other_flights_and_not_with_its_own_log",
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
        "a run judged without the scatter between flights",
        "trend/diff.py",
        "scatter(np.array(sigma), fitted.tau**2, fitted.s2)",
        "scatter(np.array(sigma), 0.0, fitted.s2)",
        TREND + "test_diff.py::test_a_run_is_judged_by_students_t_with_the_scatter_between_flights",
    ),
    Defect(
        "a difference judged as the only one of many",
        "trend/diff.py",
        "min(1.0, judged * two_sided(z, dof))",
        "min(1.0, two_sided(z, dof))",
        TREND + "test_diff.py::test_p_is_of_all_numbers_judged",
    ),
)
