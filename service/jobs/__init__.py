"""Trainings and evaluations: work of minutes to days, in processes of their own, one at a time."""

# Nothing is imported here: a job's process has to ignore signals before it loads what takes seconds.
