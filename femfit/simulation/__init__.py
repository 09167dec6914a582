"""The model simulated: driven in open loop from event to event, and in closed loop with filters and controllers."""
