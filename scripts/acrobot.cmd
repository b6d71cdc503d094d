# Acrobot: both links swung up by energy and held.
setup acrobot
start
wait-until balanced within 10
expect balanced for 20
expect no-fault
halt
save acrobot.csv
quit
