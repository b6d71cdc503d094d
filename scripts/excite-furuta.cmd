# Furuta pendulum: an input for identification found by mechkit excite, command within 1.5. The largest standard
# error that a fit of these 10 s can reach is 0.004 %; of 1.5 sin 6t: 0.023 %.
model ../models/furuta.ini
setup open-loop
input 1.5*tanh(-0.6172*sin(2.60664*t)-0.2948*cos(2.60664*t)+1.2118*sin(5.21328*t)+1.2533*cos(5.21328*t)+0.3752*sin(7.81992*t)-1.1119*cos(7.81992*t)+0.4592*sin(10.42656*t)+0.1626*cos(10.42656*t)+0.7689*sin(13.0332*t)+1.0514*cos(13.0332*t)+0.9815*sin(15.63984*t)+0.7031*cos(15.63984*t)+1.2567*sin(18.24648*t)+1.4888*cos(18.24648*t)+1.5304*sin(20.85312*t)-0.2288*cos(20.85312*t))
start
wait 10
expect no-fault
halt
save excite-furuta.csv
quit
