# Frame time and error over the path, one line a renderer.  Draw it again: gnuplot path.gp > path.svg
set terminal svg size 1120,620 noenhanced font 'sans-serif,15' background '#ffffff' name 'path'
set encoding utf8
set datafile missing '?'
set border 3 lc rgb '#777777'
set tics nomirror tc rgb '#333333'
set grid lc rgb '#e6e6e6' lw 1 lt 1
set key at screen 0.5,0.9839 center top horizontal maxrows 1 Left reverse samplen 2 tc rgb '#222222'
set multiplot
set margins screen 0.09643, screen 0.97321, screen 0.50806, screen 0.92258
set xrange [0:31]
set yrange [0:24.3619456]
set format x ''
set ylabel 'frame time (ms)'
plot 'path.dat' index 0 using 1:2 with linespoints lw 2 pt 7 ps 0.45 lc rgb '#0072B2' title 'clipmap n=127', \
  'path.dat' index 1 using 1:2 with linespoints lw 2 pt 5 ps 0.45 lc rgb '#D55E00' title 'geomipmap tau=2', \
  'path.dat' index 2 using 1:2 with linespoints lw 2 pt 9 ps 0.45 lc rgb '#009E73' title 'pgm rows=300'
unset key
set margins screen 0.09643, screen 0.97321, screen 0.11613, screen 0.46935
set xrange [0:31]
set yrange [0.698599097:2.39113351]
set logscale y
set ytics ('0.7' 0.70000000000000007, '0.8' 0.80000000000000004, '0.9' 0.90000000000000002, '1' 1, '1.2' 1.2, '1.5' 1.5, '2' 2)
set format x '%g'
set xlabel 'frame of the path' offset 0,0.3
set ylabel 'error, p99.9 (px)'
set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2
plot 'path.dat' index 0 using 1:3 with linespoints lw 2 pt 7 ps 0.45 lc rgb '#0072B2' title 'clipmap n=127', \
  'path.dat' index 1 using 1:3 with linespoints lw 2 pt 5 ps 0.45 lc rgb '#D55E00' title 'geomipmap tau=2', \
  'path.dat' index 2 using 1:3 with linespoints lw 2 pt 9 ps 0.45 lc rgb '#009E73' title 'pgm rows=300'
unset multiplot
