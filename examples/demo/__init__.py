"""The main job from end to end on a real recording: measurement, model, validation, influence, optimum, proof, report.

Run it with `make demo`, or `python -m examples.demo` once the package is installed. It starts a service of its own, talks to it
over HTTP only, and reads as what a user's script looks like: one module for each part of the work.

    systems.py      the system documents: one position loop with three control laws
    measuring.py    steps a, b, c: import the recording, identify the drive, validate it
    analysing.py    steps d, e: the starting point in numbers, and what influences it
    tuning.py       steps f, g: better control laws, by two methods, and the proof
    report/         step h: everything above on one page
"""
