# Pendubot: swing up to the semi-inverted position along the time-optimal trajectory of the kit's model,
# 0.7 s instead of 2 s (docs/swingup.md).
swingup ../models/pendubot-mid-swingup.csv
setup pendubot-mid
start
wait-until balanced within 4.5
expect balanced for 20
expect no-fault
halt
save pendubot-mid-fast.csv
quit
