"""The lab PC: takes measurements from the service, drives the rig within its limits, and loses no sample."""
