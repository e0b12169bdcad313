"""When a vehicle was in the air: signs of the sensors, heights, and the rule over both."""
