"""NI-DAQmx: the driver of this PC, or an NI gRPC Device Server."""
