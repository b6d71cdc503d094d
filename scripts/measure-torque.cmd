# Pendulum: a slow sweep against gravity, up and down on both sides. mechkit measure torque reads
# m g l off it, and with the weighed one the torque constant.
model ../models/pendulum.ini
setup open-loop
input 6.5*sin(0.4*t)
start
wait 31.5
expect no-fault
halt
save measure-torque.csv
quit
