# Reaction-wheel pendulum: pump to the upright position, take over without a transient, hold it.
setup reaction-wheel
start
wait-until balanced within 4.5
expect balanced for 20
expect no-fault
halt
save reaction-wheel.csv
quit
