function figures = mk_compare(measured, simulated, varargin)
%MK_COMPARE  Hold a simulation against a measurement.
%   F = MK_COMPARE(MEASURED, SIMULATED)   runs from MK_LOAD, or what MK_SIMULATE returned
%   F has for each joint: rms (the measured signal's unit), nrmse (rms over the standard deviation of the
%   measurement), worst. Draws both and their difference; 'visible', 'off' hides the window,
%   'draw', false draws nothing.
  opt = struct('visible', 'on', 'draw', true);
  for k = 1:2:numel(varargin)
    opt.(varargin{k}) = varargin{k + 1};
  end
  two = isfield(measured.signals, 'q2') && isfield(simulated.signals, 'q2');
  for j = 1:(1 + two)
    name = sprintf('q%d', j);
    y = measured.signals.(name);
    s = simulated.signals.(name) * mk_unit(simulated.units.(name)) / mk_unit(measured.units.(name));
    if numel(s) ~= numel(y) || any(abs(simulated.time - measured.time) > 1e-9)
      s = interp1(simulated.time, s, measured.time);
    end
    e = s - y;
    good = ~isnan(e);
    figures.rms(j) = sqrt(mean(e(good) .^ 2));
    figures.nrmse(j) = figures.rms(j) / std(y(good), 1);
    figures.worst(j) = max(abs(e(good)));
    errors{j} = e; %#ok<AGROW>
    curves{j} = s; %#ok<AGROW>
  end
  if opt.draw
    draw(measured, curves, errors, figures, opt);
  end
end

function draw(measured, curves, errors, figures, opt)
  n = numel(curves);
  figure('visible', opt.visible, 'name', measured.name);
  for j = 1:n
    name = sprintf('q%d', j);
    subplot(2 * n, 1, 2 * j - 1);
    plot(measured.time, measured.signals.(name), measured.time, curves{j}, '--');
    grid on;
    legend('measured', 'simulated');
    ylabel(sprintf('%s [%s]', name, measured.units.(name)));
    title(sprintf('nrmse %.3g', figures.nrmse(j)));
    subplot(2 * n, 1, 2 * j);
    plot(measured.time, errors{j});
    grid on;
    ylabel('difference');
  end
  xlabel('t [s]');
end
