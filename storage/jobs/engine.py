"""What the two sides of the job engine, those who ask and those who work, must agree on."""

from __future__ import annotations

from dbos import DBOSPortableJSONSerializer

#: The application's name in the engine's tables.
APPLICATION = "servotune"
#: The queue of all jobs, a partition of it for each workspace, and the workflow that does one.
QUEUE = "work"
WORKFLOW = "run_job"
#: Counts the shapes of the workflow: its arguments and the order of its steps. A change that a job begun before
#: cannot live with needs the next number; a release of the software does not.
SHAPE = "1"

#: JSON, never pickle: rows outlive the software that wrote them.
SERIALIZER = DBOSPortableJSONSerializer()
