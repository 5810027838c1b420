"""An independent bench: logs of a loader with known truth, made without any code of payscope.

Nothing in this folder imports estimators, analysis, recordings or replay: a simulator that shares
the model of the fit agrees with the fit. A driver's `legs` and the `machine` go into the `plant`,
`sensors` measure its motion, `mcap_log` writes what they say, `machine_file` states what the owner
knows; `payload_plans` and `shift_plans` draw what is driven, and `shift_logs` makes files of it.
"""
