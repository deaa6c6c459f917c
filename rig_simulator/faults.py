"""What a driver complains about: numbers from nidaqmx.error_codes, sentences of our own."""

from __future__ import annotations

MESSAGES = {
    -50103: "The resource is reserved by another task.",
    -50405: "No transfer is in progress: the connection to the device has broken.",
    -89120: "No device has the terminal from which a signal is to be routed.",
    -89125: "No line for triggers leads from one device to the other.",
    -200077: "The value is not one that the property supports on this device.",
    -200088: "The task does not exist.",
    -200089: "There is a task of this name already.",
    -200170: "The device has no such physical channel.",
    -200220: "There is no device of this name.",
    -200262: "A trigger needs a sample clock: the task is timed on demand.",
    -200278: "The finite acquisition holds no more samples than have been read.",
    -200279: "The samples were not read in time: the buffer has overflowed.",
    -200284: "Some or all of the samples requested have not been acquired yet.",
    -200290: "The generation stopped, because no new samples were written in time.",
    -200303: "The task has no sample clock of its own: name its source.",
    -200428: "The task has no channels.",
    -200431: "The physical channel cannot measure what the channel of the task is to measure.",
    -200432: "The physical channel cannot generate what the channel of the task is to generate.",
    -200452: "The property is not supported here.",
    -200462: "The generation cannot start without samples in its buffer.",
    -200558: "The task has channels of several devices, which cannot be in one task.",
    -200561: "The value must be within the range of the channel.",
    -200560: "The task was not done within the time given.",
    -200709: "No sensor with a data sheet is connected.",
    -200741: "The device reads no data sheets of sensors.",
    -200762: "Who follows the timebase of another device needs its sync pulse, too.",
    -200983: "The property is known when the task has been reserved.",
    -201003: "The device cannot be accessed: it is unplugged, or without power.",
}


class DriverError(Exception):
    """A call that fails as the driver's would.

    Parameters
    ----------
    code : int
        Negative.
    detail : str
        What the message names.
    read : int, optional
        Samples of each channel that were read in spite of it.
    """

    def __init__(self, code: int, detail: str = "", *, read: int | None = None) -> None:
        lines = [MESSAGES.get(code, "Unknown."), detail, f"Status Code: {code}"]
        super().__init__("\n".join(line for line in lines if line))
        self.code = code
        self.read = read
