function frame = mk_animate(run, varargin)
%MK_ANIMATE  Show a run as the rig moves.
%   MK_ANIMATE(R)                     in real time
%   MK_ANIMATE(R, 'speed', 0.25)      slower
%   MK_ANIMATE(R, 'rate', 10)         frames a second (default 25)
%   MK_ANIMATE(R, 'file', 'run.gif')  also as an animated GIF
%   MK_ANIMATE(R, 'visible', 'off')   without a window, as fast as it goes
%   Returns the corners of the last frame (2 or 3 x N). The rig is R.rig.
  opt = struct('speed', 1, 'rate', 25, 'file', '', 'visible', 'on');
  for k = 1:2:numel(varargin)
    opt.(varargin{k}) = varargin{k + 1};
  end
  q = angles(run);
  h = figure('visible', opt.visible, 'name', run.name);
  at = run.time(1):(opt.speed / opt.rate):run.time(end);
  line_handle = [];
  frame = [];
  for k = 1:numel(at)
    start = tic();
    frame = corners(run.rig, interp1(run.time, q, at(k)));
    if isempty(line_handle)
      line_handle = prepare(frame);
    end
    set(line_handle, 'xdata', frame(1, :), 'ydata', frame(2, :));
    if size(frame, 1) == 3
      set(line_handle, 'zdata', frame(3, :));
    end
    title(sprintf('%s, t = %.2f s', run.rig, at(k)));
    drawnow();
    if ~isempty(opt.file)
      write_frame(h, opt, k);
    elseif strcmp(opt.visible, 'on')
      pause(max(0, 1 / opt.rate - toc(start)));
    end
  end
end

function q = angles(run)
  q = run.signals.q1 * mk_unit(run.units.q1);
  if isfield(run.signals, 'q2')
    q(:, 2) = run.signals.q2 * mk_unit(run.units.q2);
  end
end

function h = prepare(frame)
  if size(frame, 1) == 3
    h = plot3(frame(1, :), frame(2, :), frame(3, :), '-o', 'linewidth', 3);
    axis([-2 2 -2 2 -1.5 1.5]);
  else
    h = plot(frame(1, :), frame(2, :), '-o', 'linewidth', 3);
    axis([-2.2 2.2 -2.2 2.2]);
  end
  axis('square');
  grid on;
end

function p = corners(rig, q)
  switch rig
    case 'pendubot'
      first = [cos(q(1)); sin(q(1))];
      p = [[0; 0], first, first + [cos(q(1) + q(2)); sin(q(1) + q(2))]];
    case 'reaction-wheel'
      hub = [sin(q(1)); -cos(q(1))];
      turn = linspace(0, 2 * pi, 25) + q(1) + q(2);
      rim = bsxfun(@plus, hub, 0.4 * [sin(turn); -cos(turn)]);
      p = [[0; 0], hub, rim, hub];
    case 'furuta'
      tip = [cos(q(1)); sin(q(1)); 0];
      side = [-sin(q(1)); cos(q(1)); 0];
      p = [[0; 0; 0], tip, tip + sin(q(2)) * side + cos(q(2)) * [0; 0; 1]];
    case 'inertia-wheel'
      turn = linspace(0, 2 * pi, 25) + q(1);
      p = [[0; 0], [cos(turn); sin(turn)], [0; 0]];
    otherwise
      p = [[0; 0], [sin(q(1)); -cos(q(1))]];
  end
end

function write_frame(h, opt, k)
  if exist('OCTAVE_VERSION', 'builtin')
    name = [tempname() '.png'];
    print(h, name, '-dpng', '-r60');
    picture = imread(name);
    delete(name);
  else
    picture = frame2im(getframe(h));
  end
  [indexed, map] = rgb2ind(picture);
  if k == 1
    imwrite(indexed, map, opt.file, 'gif', 'DelayTime', 1 / opt.rate, 'LoopCount', Inf);
  else
    imwrite(indexed, map, opt.file, 'gif', 'DelayTime', 1 / opt.rate, 'WriteMode', 'append');
  end
end
