# Inertia wheel: eight ramps, +-20 to +-80 rad/s^2. mechkit measure inertia reads the inertia off
# them.
model ../models/inertia-wheel.ini
setup pi-speed
ref 20*ramp(0) - 60*ramp(4) + 40*ramp(8) + 40*ramp(10) - 80*ramp(12) + 40*ramp(14) + 60*ramp(16) - 120*ramp(18) + 60*ramp(20) + 80*ramp(22) - 160*ramp(24) + 80*ramp(26)
start
wait 28
expect no-fault
halt
save measure-inertia.csv
quit
