# Inertia wheel: a step of 50 rad/s, a ramp, and back.
setup pi-speed
ref 50*step(0.5) + 10*(ramp(5) - ramp(8)) - 120*step(9)
start
wait 4.5
expect dq1 within 2% of 50
wait 4
expect dq1 within 2% of 80
wait 3
expect dq1 within 2% of -40 for 1
expect no-fault
halt
save pi-speed.csv
quit
