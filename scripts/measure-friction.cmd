# Inertia wheel: six constant speeds each way. mechkit measure friction reads friction off them.
model ../models/inertia-wheel.ini
setup pi-speed
ref 10 + 10*step(3) + 20*step(6) + 20*step(9) + 20*step(12) + 20*step(15) - 110*step(18) - 10*step(22) - 20*step(25) - 20*step(28) - 20*step(31) - 20*step(34)
start
wait 37
expect no-fault
halt
save measure-friction.csv
quit
