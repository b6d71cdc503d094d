# Reaction wheel: the wheel pumps the pendulum, is braked, and friction locks it; then the pendulum
# swings freely. mechkit measure swing reads the natural frequency off.
model ../models/reaction-wheel.ini
setup open-loop
input 6*sin(8.87*t)*pulse(0, 5.667)
start
wait 20
expect no-fault
halt
save measure-swing-reaction-wheel.csv
quit
