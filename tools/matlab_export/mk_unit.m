function size = mk_unit(unit)
%MK_UNIT  How much one of a unit is in the units of a log: rad, rad/s, s, N m.
%   MK_UNIT('deg') is pi / 180; '' is 1.
  switch unit
    case {'', 's', 'rad', 'rad/s', 'Nm'}
      size = 1;
    case {'ms', 'mrad', 'mNm'}
      size = 1e-3;
    case 'us'
      size = 1e-6;
    case 'ns'
      size = 1e-9;
    case 'min'
      size = 60;
    case {'deg', 'deg/s'}
      size = pi / 180;
    case {'rev', 'rev/s'}
      size = 2 * pi;
    case 'rpm'
      size = 2 * pi / 60;
    otherwise
      error('mk_unit:unit', 'unknown unit %s', unit);
  end
end
