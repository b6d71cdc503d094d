function u = mk_inputs(run)
%MK_INPUTS  The command of a run as the models take it: N x 2, the second column the torque on
%   joint 2 of a rig with two motors (else 0). A value that is missing is held from before. A
%   command that was exported in N m is turned back by the u_to_torque of the run's metadata.
  s = run.signals;
  zero = zeros(numel(run.time), 1);
  if isfield(s, 'u1')
    u = [s.u1, pick(s, 'u2', zero)] * size_of(run, 'u1');
  elseif isfield(s, 'tau1')
    u = [s.tau1, pick(s, 'tau2', zero)] * size_of(run, 'tau1');
  elseif isfield(s, 'u')
    u = [s.u, zero] * size_of(run, 'u');
  else
    u = [s.tau, zero] * size_of(run, 'tau');
  end
  u(1, isnan(u(1, :))) = 0;
  for k = find(any(isnan(u), 2))'
    u(k, isnan(u(k, :))) = u(k - 1, isnan(u(k, :)));
  end
end

function size = size_of(run, name)
  unit = run.units.(name);
  size = mk_unit(unit);
  if name(1) == 'u' && ~isempty(unit)
    if isfield(run.metadata, 'u_to_torque')
      size = size / str2double(run.metadata.u_to_torque);
    elseif ~isempty(run.model)
      size = size / run.model.u_to_torque;
    else
      error('mk_inputs:unit', '%s is in %s, and nothing says how many N m a unit of it is', name, unit);
    end
  end
end

function column = pick(s, name, missing)
  column = missing;
  if isfield(s, name)
    column = s.(name);
  end
end
