"""What follows from a case: functions that the checks and `resolve` share."""
